"""A night of campaigns goes on where it was stopped, and leaves its results by date."""

import importlib.util
import sys

import pytest

from campaigns.night import PARTS, Night, code_of_now, commands, night, spend

PASSES, FAILS = "print('as it should be')", "print('wrong'); raise SystemExit(1)"


def python(text):
    return [sys.executable, "-c", text]


@pytest.fixture
def marked(tmp_path):
    """A command that passes when it runs for the second time, and the file that it leaves."""
    mark = tmp_path / "mark"
    return python(
        f"import pathlib; mark = pathlib.Path({str(mark)!r}); first = not mark.exists(); mark.touch(); exit(first)"
    )


def test_what_has_passed_is_not_repeated_and_what_has_failed_is(tmp_path, marked):
    every = {"first": python(PASSES), "second": marked}
    begun = night(list(every), "abc", tmp_path / "kept")
    assert spend(begun, every) == 1
    (begun.folder / "first.txt").write_text("of the first time", "utf-8")
    again = night(list(every), "abc", tmp_path / "kept")
    assert again.folder == begun.folder
    assert spend(again, every) == 0
    assert (begun.folder / "first.txt").read_text("utf-8") == "of the first time"
    assert [each.status for each in again.ended().values()] == ["0", "0"]


def test_a_night_leaves_what_each_command_printed(tmp_path, capfd):
    found = Night(tmp_path / "night", "abc")
    assert spend(found, {"one": python(PASSES), "other": python(FAILS)}) == 1
    assert (found.folder / "one.txt").read_text("utf-8") == "as it should be\n"
    assert [(each.name, each.status, each.code) for each in found.ended().values()] == [
        ("one", "0", "abc"), ("other", "1", "abc")
    ]  # fmt: skip
    assert "other                     0 s  FAILED, see other.txt" in capfd.readouterr().out


@pytest.mark.parametrize(
    ("code", "names", "again", "new"),
    [
        ("abc", ["one", "other"], False, False),
        ("abc", ["one"], False, True),
        ("other code", ["one", "other"], False, True),
        ("abc", ["one", "other"], True, True),
    ],
)
def test_other_code_or_nothing_left_begins_a_new_one(tmp_path, code, names, again, new):
    begun = Night(tmp_path / "2020-01-01_200000", "abc")
    spend(begun, {"one": python(PASSES)})
    assert (night(names, code, tmp_path, again=again).folder != begun.folder) == new


def test_every_command_is_a_program_of_the_campaigns():
    every = list(commands(list(PARTS), minutes=5))
    assert len({name for name, _ in every}) == len(every) > len(PARTS)
    for _, (_, _, module, *_) in every:
        assert importlib.util.find_spec(module) is not None
    assert every[-1][1][-2:] == ["--minutes", "5"]


def test_campaigns_with_workers_go_to_the_scheduler_that_is_given():
    given = dict(commands(list(PARTS), 5, "tls://cluster:8786"))
    assert given["truth"][-2:] == ["--scheduler", "tls://cluster:8786"]
    assert "--scheduler" not in given["trials"]


def test_code_of_now_names_a_commit():
    assert code_of_now().partition("+")[0]
