"""The glossary explains words that the project uses, in alphabetical order, and the README leads to it."""

from __future__ import annotations

import re

import pytest

from tests.support.runs import ROOT

PAGE = ROOT / "docs/glossary.md"
GROUPS = [
    re.findall(r"^\* \*\*([^*]+)\*\*(?: of a \w+)?: \*[^*]+\*\. [A-Z`\"]", group, re.MULTILINE)
    for group in re.split(r"^## ", PAGE.read_text("utf-8"), flags=re.MULTILINE)[1:]
]
TERMS = [term for group in GROUPS for term in group]


@pytest.fixture(scope="module")
def elsewhere() -> str:
    """Every text of the project but the glossary."""
    folders = ("bench", "docs", "sequences", "config")
    paths = (path for folder in folders for path in (ROOT / folder).rglob("*"))
    return "\n".join(
        path.read_text("utf-8") for path in paths if path.suffix in (".py", ".md", ".yaml") and path != PAGE
    )


def test_every_entry_has_a_term_the_standard_one_and_a_sentence() -> None:
    assert len(TERMS) == len(re.findall(r"^\* ", PAGE.read_text("utf-8"), re.MULTILINE)) > 50


def test_entries_of_a_group_are_in_alphabetical_order() -> None:
    assert [group for group in GROUPS if group != sorted(group)] == []


@pytest.mark.lengthy
def test_every_term_is_used_elsewhere(elsewhere: str) -> None:
    words = [re.compile(rf"\b{re.escape(term)}\b", re.IGNORECASE) for term in TERMS]
    assert [word.pattern for word in words if len(word.findall(elsewhere)) < 3] == []


def test_the_readme_leads_to_it() -> None:
    assert "](docs/glossary.md)" in (ROOT / "README.md").read_text("utf-8")
