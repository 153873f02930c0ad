"""What became of the chambers after a run, in its report, whoever has written to that record."""

from __future__ import annotations

import json
import os
import re
import shutil
from pathlib import Path

import pytest

from bench.figures.after_run import last_states
from bench.reduce.stored_run import open_run
from bench.report.write import write_report
from bench.store.followed import FOLLOWED
from bench.store.verify import examine

AT = "2026-03-01T05:06:07.000+00:00"
SCRIPT = "<script>alert(1)</script>"


@pytest.fixture(scope="module")
def sealed(shared_runs, tmp_path_factory) -> Path:
    smoke_run = shared_runs.smoke()
    return Path(shutil.copytree(smoke_run.path, tmp_path_factory.mktemp("after") / smoke_run.path.name))


@pytest.fixture
def run(sealed) -> Path:
    """A run of which nothing is on record after its end."""
    (sealed / FOLLOWED).unlink(missing_ok=True)
    return sealed


def written(run: Path, *lines: str | dict[str, object], lang: str = "en") -> str:
    """The page with a record of these lines."""
    texts = [line if isinstance(line, str) else json.dumps({"at": AT, "role": "chamber", **line}) for line in lines]
    (run / FOLLOWED).write_text("".join(f"{text}\n" for text in texts), "utf-8")
    return page(run, lang)


def page(run: Path, lang: str = "en") -> str:
    with open_run(run) as stored:
        return write_report(stored, lang=lang).read_text("utf-8")


def after(html: str) -> str:
    """The part of a page that is about what came after the run."""
    found = re.search(r'<div class="(alert|note)" id="after">.*?</div>', html, re.DOTALL)
    return "" if found is None else found.group()


COMMANDED = {"event": "commanded", "is_complete": False}
ARRIVED = {"event": "arrived", "air_c": 26.4, "set_point_c": 25.0}
LATE = {"event": "not_arrived", "why": "the air does not approach", "air_c": 60.0}


def test_a_look_that_failed_is_no_end_of_a_hold(run):
    unseen = {"event": "not_seen", "why": "it does not answer"}
    reported = after(written(run, {"event": "held", "set_point_c": 60.0, "air_c": 59.8}, unseen, COMMANDED))
    assert "was held until" not in reported
    assert "the safe set point was commanded" in reported


def test_without_a_record_nothing_is_said(run):
    assert after(page(run)) == ""


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([COMMANDED], "the safe set point was commanded at 2026-03-01 "),
        ([COMMANDED, ARRIVED], "its air arrived at the safe set point at 2026-03-01 "),
        ([COMMANDED, ARRIVED], ", at 26.4 °C."),
        ([COMMANDED, LATE], "chamber: HAS NOT ARRIVED at the safe set point"),
        ([{"event": "held", "set_point_c": -40.0, "air_c": -39.8}], "held by its guardian at -40.0 °C, last read at"),
        ([{"event": "held"}, {"event": "hold_ends", "why": "the hold time has expired"}, COMMANDED], "was held until"),
        ([COMMANDED, {"event": "handed_over", "why": "a run of x has taken the bench"}], "handed over at"),
        ([COMMANDED, {"event": "ended"}], "no longer followed since"),
    ],
)
def test_what_became_of_a_chamber_is_on_page_one_with_whose_record_that_is(run, lines, words):
    html = written(run, *lines)
    assert words in after(html)
    assert "followed.jsonl, not under the seal of the run" in after(html)
    assert html.index('id="after"') < html.index('id="run"')
    assert ('class="alert" id="after"' in html) == (LATE in lines)


def test_a_report_that_is_written_again_shows_the_newest_state_and_is_a_revision_of_its_own(run):
    assert "arrived at the safe" not in written(run, COMMANDED)
    again = written(run, COMMANDED, ARRIVED)
    assert "arrived at the safe" in again
    number = re.compile(r"revision (\d+)")
    assert int(number.search(again)[1]) == int(number.search(written(run, COMMANDED))[1]) - 1
    assert page(run, "zh").count("revision") == 0
    assert examine(run, thoroughly=False).damage == ()


def test_it_is_told_in_chinese(run):
    assert "箱内空气于 2026-03-01 " in after(written(run, COMMANDED, ARRIVED, lang="zh"))
    assert "未到达安全设定温度" in after(written(run, LATE, lang="zh"))


HOSTILE = [
    {"event": "arrived", "air_c": 10**400},
    {"event": "arrived", "air_c": float("nan"), "at": "9999-12-31T23:59:59-23:59"},
    {"event": "arrived", "air_c": "hot", "at": 7},
    {"event": "arrived", "air_c": True, "at": "2026-03-01"},
    {"event": "held", "set_point_c": {"a": []}, "air_c": []},
    {"event": "not_arrived", "why": SCRIPT + "{text.__class__}\x1b[2J\ud800" + "x" * 100_000},
    {"event": "hold_ends", "why": SCRIPT},
    {"event": "ended", "why": ["a"]},
    {"event": SCRIPT},
    {"event": ["arrived"]},
    {"event": "arrived", "role": SCRIPT},
    {"event": "arrived", "role": {"chamber": 1}},
    "[" * 5000,
    "null",
    "7" * 5000,
    "\x00\xff",
]


@pytest.mark.parametrize("line", HOSTILE, ids=range(len(HOSTILE)))
def test_no_entry_breaks_the_page_or_gets_into_it(run, line):
    for html in (written(run, COMMANDED, line), written(run, line, lang="zh")):
        assert "<script" not in html
        assert "\x1b" not in html
        assert len(after(html)) < 3000
        assert after(html) or isinstance(line, dict)  # of another device
    assert "\x1b" not in "".join(last_states(run).values())


def test_lines_that_cannot_be_read_are_counted(run):
    assert "Entries of this record that cannot be read: 2." in after(written(run, COMMANDED, "{", "7"))


@pytest.mark.parametrize("kind", ["pipe", "folder", "endless"])
def test_what_is_no_file_is_told_and_not_waited_for(run, kind):
    path = run / FOLLOWED
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to("/dev/zero")
    try:
        assert "cannot be read: 1." in after(page(run))
    finally:
        path.rmdir() if kind == "folder" else path.unlink()
