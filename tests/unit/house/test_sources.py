"""The page of the sources: every stated section has a row, and every row names text of a shipped sequence."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from bench.sequence.load import load_sequence
from tests.support.runs import ROOT

PAGE = ROOT / "docs/explanation/sources.md"
PUBLISHED = (
    "accel_range", "accel_response", "channel_full", "channel_gravity", "channel_imu", "channel_skew", "channel_source",
    "gyro_range", "gyro_response", "imu_24_position", "indexing_static", "ramp_dynamic", "tumble_static",
)  # fmt: skip
LINK = re.compile(r"\[([\d.]+)\]\(([^)#]+)#?([^)]*)\)")
CODE = re.compile(r"`([^`]+)`")
STATED = re.compile(r"\bstated\b(?! scale)")
PROVED_ELSEWHERE = {  # sections that state something of a source which is no step of a schedule
    "channel": {"2.7"},  # what a result states
    "rate_table": {"5.6"},  # symbols of the two-sample reference
    "tumble": {"6.5"},  # printed results
}


MARK = re.compile(r"\(([^()]*\b(?:stated|derived|chosen here)\b[^()]*)\)|\b(Stated|Chosen here|Derived)[^:.;]*:")
FIGURE = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?![\w.]*[/\w])")


class Row(NamedTuple):
    """A row of a table of the page; `section` and `step` are empty in the table of what no source has."""

    section: str
    step: str
    file: str
    named: tuple[str, ...]
    remark: str


@cache
def rows() -> tuple[Row, ...]:
    found = []
    for line in PAGE.read_text("utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split(" | ")] if line.startswith("| ") else []
        if len(cells) < 3 or cells[0] in ("Section", "Part") or set(cells[0]) == {"-"}:
            continue
        where, remark = cells[-2].strip(), cells[-1].rstrip(" |")
        file, *named = CODE.findall(where)
        section = LINK.sub(r"\1", cells[0]) if len(cells) == 4 else ""
        found.append(Row(section, cells[1] if section else "", file, tuple(named), remark))
    return tuple(found)


def parameters_and_presets(name: str):
    _, sequence = load_sequence(ROOT / f"sequences/{name}.yaml")
    return sequence.parameters, sequence.presets


def stated_figures(page: Path) -> set[tuple[str, str]]:
    """Section and figure of everything that the running text of a method's page marks as stated.

    A mark in brackets is of the text before it, `Stated:` of that after it.
    """
    text = page.read_text("utf-8")
    number = re.match(r"# ([\d.]+)", text)[1]
    found = set()
    for part in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        section = re.match(r"[\d.]*", part)[0] or number
        for paragraph in re.sub(r"```.*?```", "", part, flags=re.DOTALL).split("\n\n"):
            if not paragraph.startswith(("|", "    ")):
                found |= {(section, figure) for figure in FIGURE.findall(stated_part(paragraph))}
    return found


def stated_part(paragraph: str) -> str:
    """The text of a paragraph that is marked as stated."""
    stated, since, after = "", 0, ""
    for mark in MARK.finditer(paragraph):
        before = paragraph[since : mark.start()]
        if "tated" in after or (not after and mark[1] and "stated" in mark[1]):
            stated += before
        since, after = mark.end(), mark[2] or ""
    return stated + (paragraph[since:] if after == "Stated" else "")


def stated_sections(page: Path) -> set[str]:
    """Numbered sections of a method's page that state something of its source."""
    text = page.read_text("utf-8")
    first = re.match(r"# ([\d.]+)", text)
    parts = re.split(r"^## ", text, flags=re.MULTILINE)
    numbers = {
        re.match(r"[\d.]*", part)[0] or (first[1] if "." in first[1] else "")
        for part in parts[1:]
        if STATED.search(part)
    }
    return numbers - {""}


def test_there_are_many_rows():
    assert len(rows()) > 60


@pytest.mark.parametrize("row", rows(), ids=lambda row: f"{row.section} {row.file} {row.named[:1]}")
def test_a_row_names_text_of_a_sequence_and_says_what_is_otherwise(row):
    text = (ROOT / "sequences" / row.file).read_text("utf-8")
    assert row.named
    assert [named for named in row.named if named not in text] == []
    assert len(row.remark) > 5


@pytest.mark.parametrize("method", sorted(path.parent.name for path in (ROOT / "bench/methods").glob("*/README.md")))
def test_every_section_that_states_something_of_a_source_has_a_row(method):
    stated = stated_sections(ROOT / f"bench/methods/{method}/README.md")
    assert stated - {row.section for row in rows()} - PROVED_ELSEWHERE.get(method, set()) == set()


SCHEDULES = {"2.2", "2.3", "3.1", "3.2", "4.1", "4.2", "4.3", "5.1", "5.2", "5.3", "5.4", "5.5", "6.1", "6.2", "6.3"}


def test_every_stated_figure_of_a_schedule_is_in_a_row_of_its_section():
    pages = (ROOT / "bench/methods").glob("*/README.md")
    stated = {each for page in pages for each in stated_figures(page) if each[0] in SCHEDULES}
    in_rows = {
        (row.section, figure) for row in rows() for figure in re.findall(r"\d+(?:\.\d+)?", f"{row.step} {row.named}")
    }
    assert len(stated) > 30
    assert sorted(stated - in_rows) == []


@pytest.mark.parametrize("name", PUBLISHED)
def test_every_figure_of_a_preset_is_in_a_row_of_its_sequence(name):
    parameters, presets = parameters_and_presets(name)
    chosen = presets["as_published"].set
    named = " ".join(" ".join(row.named) for row in rows() if row.file == f"{name}.yaml")
    assert chosen.keys() <= parameters.keys()
    assert [key for key in chosen if not re.search(rf"\b{key}\b", named)] == []


def test_no_other_sequence_has_such_a_preset():
    names = {path.stem for path in (ROOT / "sequences").glob("*.yaml") if "  as_published:" in path.read_text("utf-8")}
    assert names == set(PUBLISHED)


def test_links_lead_to_headings():
    links = LINK.findall(PAGE.read_text("utf-8"))
    assert links
    for number, path, anchor in links:
        headings = re.findall(r"^#+ (.*)$", (PAGE.parent / path).read_text("utf-8"), re.MULTILINE)
        anchors = {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}
        assert not anchor or anchor in anchors, number
