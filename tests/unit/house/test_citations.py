"""Equations that are cited by number are in a page of a method, of the shared metrology or of the simulators."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.support.runs import ROOT

PAGES = sorted([*(ROOT / "bench").rglob("README.md"), ROOT / "simulators/README.md"])
CITED = re.compile(r"equations (\d+(?:\.\d+)?(?:(?:,| and) \d+(?:\.\d+)?)*)")
FOLDERS = ("bench", "drivers", "simulators", "tests", "campaigns", "docs", "sequences", "config")


def headings() -> dict[str, Path]:
    """The page of each numbered section."""
    found = {}
    for page in PAGES:
        for number in re.findall(r"^#+ (\d+(?:\.\d+)?)\b", page.read_text("utf-8"), re.MULTILINE):
            found[number] = page
    return found


def citing() -> list[Path]:
    """Every file that cites equations."""
    every = (path for folder in FOLDERS for path in (ROOT / folder).rglob("*"))
    texts = (path for path in every if path.suffix in (".py", ".md", ".yaml"))
    return sorted(path for path in texts if CITED.search(path.read_text("utf-8")))


@pytest.mark.parametrize("path", citing(), ids=lambda path: path.relative_to(ROOT).as_posix())
def test_equations_that_are_cited_are_in_a_page(path):
    known = headings()
    cited = [
        number for found in CITED.findall(path.read_text("utf-8")) for number in re.findall(r"\d+(?:\.\d+)?", found)
    ]
    assert cited
    assert [number for number in cited if number not in known] == []


def test_many_equations_are_cited():
    assert len(citing()) > 80
