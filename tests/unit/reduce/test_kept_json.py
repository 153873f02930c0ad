"""JSON files of a run that somebody has edited: refused in words, whatever stands in them."""

import json
from pathlib import Path

import pytest

from bench.errors import BenchError, InputError
from bench.reduce.reduced_again import reduced_again
from bench.reduce.stored_run import open_run
from bench.report.revision import examined
from bench.report.status_text import runs_table, status_lines
from bench.report.write import write_report
from bench.runner.tell import send_command
from bench.store.manifest_form import WHOLE_MANIFEST
from bench.store.runs import list_runs, summary
from tests.support.unpacked import unpack

FORMATS = Path(__file__).parents[2] / "formats"
WRONG = ("7", 7, -1.5, True, None, [], [1], {}, {"a": 1}, [[]], "\x00", "x" * 10**6)
TEXTS = ("", "{", "[]", "null", "7", '"x"', "{}", "[" * 10**5, '{"a":' * 10**5, '{"state": NaN}', '{"seed": 1e999}',
         '{"state": "\\ud800"}', '{"seed": ' + "9" * 5000 + "}", "\xff")  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    """A run of a format without a seal, of which the form of its manifest is all that protects it."""
    unpack(FORMATS / "v1_finished.tar.xz", tmp_path)
    return tmp_path / "run_v1_finished"


def look_at(folder):
    """Whatever reads the manifest; a BenchError is what a person is told."""
    list(runs_table(list(list_runs(folder.parent))))
    examined(folder)
    try:
        with open_run(folder, damaged=True) as stored:
            reduced_again(stored)
            write_report(stored, "json")
    except BenchError:
        return False
    return True


@pytest.mark.parametrize("key", WHOLE_MANIFEST)
def test_a_manifest_with_a_value_of_another_type(folder, key):
    path = folder / "manifest.json"
    content = json.loads(path.read_text("utf-8"))
    for wrong in WRONG:
        path.write_text(json.dumps({**content, key: wrong}), "utf-8")
        look_at(folder)
    del content[key]
    path.write_text(json.dumps(content), "utf-8")
    assert not look_at(folder)


@pytest.mark.parametrize("name", ["manifest.json", "results.json", "report_revisions.json"])
def test_what_is_no_such_file_at_all(folder, name):
    for text in TEXTS:
        (folder / name).write_text(text, "latin-1")
        look_at(folder)
    if name == "manifest.json":
        assert (summary(folder).state, summary(folder).manifest) == ("damaged", {})


@pytest.mark.parametrize("text", [*TEXTS, '{"socket": 7, "stop": 8}', '{"socket": "\\u0000", "stop": "\\u0000"}'])
def test_a_runner_that_is_none(folder, text):
    (folder / "runner.json").write_text(text, "latin-1")
    with pytest.raises(InputError, match="this run is not running"):
        send_command(folder, "status")


def test_the_state_of_a_run_is_printed_whatever_its_manifest_lacks(folder):
    (folder / "manifest.json").write_text('{"state": "completed", "units": [{"place": "a"}]}')
    assert summary(folder).state == "damaged"
    (folder / "manifest.json").write_text('{"state": "completed"}')
    state = dict.fromkeys(("under_way", "held_by", "limits_failed", "left_out", "problems"), ())
    empty = {key: {} for key in ("variables", "dropped", "lost")}
    assert list(status_lines(summary(folder), {"state": "completed", "done": 0, **state, **empty}))
