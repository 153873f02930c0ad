"""Results of a campaign on the disk."""

import json
from dataclasses import replace

import pytest

from bench.campaign.ledger import DIFFERING, RESULTS, Ledger, opened
from bench.campaign.tasks import Result, Task
from bench.errors import InUseError, StoreError

TASK = Task("night 1", "module:function", {"seed": 1})


def result(task=TASK, content=1.0, problem="", program="abc", worker="here:1"):
    content = None if problem else content
    return Result(task.key, task.digest, program, content, problem, 1.5, "2026-01-01T00:00:00+00:00", worker)


def test_what_was_added_is_known_again(tmp_path):
    Ledger(tmp_path, "abc").add([result()])
    again = Ledger(tmp_path, "abc")
    assert again.known(TASK) == result()
    assert again.known(Task("night 1", "module:function", {"seed": 2})) is None
    assert again.others == 0


@pytest.mark.parametrize("cut", [1, 2, 30, -1])
def test_a_line_that_a_crash_has_cut_is_passed_over_and_the_next_is_a_line_of_its_own(tmp_path, cut):
    other = Task("night 2", "module:function", {"seed": 2})
    Ledger(tmp_path, "abc").add([result(), result(other)])
    path = tmp_path / RESULTS
    whole = path.read_bytes()
    path.write_bytes(whole[: whole.index(b"\n") + 1 + (cut if cut > 0 else len(whole) - whole.index(b"\n") - 3)])
    cut_off = Ledger(tmp_path, "abc")
    assert cut_off.known(TASK) is not None
    assert cut_off.known(other) is None
    cut_off.add([result(other)])
    assert Ledger(tmp_path, "abc").known(other) == result(other)


def test_results_of_another_program_are_kept_and_not_used(tmp_path):
    Ledger(tmp_path, "abc").add([result()])
    other = Ledger(tmp_path, "def")
    assert other.known(TASK) is None
    assert other.others == 1
    other.add([result(program="def", content=2.0)])
    assert Ledger(tmp_path, "abc").known(TASK).content == 1.0
    assert Ledger(tmp_path, "def").known(TASK).content == 2.0


def test_a_second_result_that_agrees_is_not_written(tmp_path):
    ledger = Ledger(tmp_path, "abc")
    ledger.add([result(content={"a": 1, "b": [1.5]})])
    ledger.add([result(content={"b": [1.5], "a": 1}, worker="there:2")])
    assert len((tmp_path / RESULTS).read_text("utf-8").splitlines()) == 1
    assert ledger.differing([TASK]) == []


def test_a_second_result_that_differs_is_told_also_by_the_next_command(tmp_path):
    ledger = Ledger(tmp_path, "abc")
    ledger.add([result()])
    ledger.add([result(content=1.0000000000000002, worker="there:2")])
    assert [each.worker for each in ledger.differing([TASK])] == ["there:2"]
    assert [each.worker for each in Ledger(tmp_path, "abc").differing([TASK])] == ["there:2"]
    assert Ledger(tmp_path, "def").differing([TASK]) == []
    assert ledger.known(TASK).content == 1.0
    assert (tmp_path / DIFFERING).exists()


def test_a_failure_is_replaced_by_a_result_and_not_the_other_way(tmp_path):
    ledger = Ledger(tmp_path, "abc")
    ledger.add([result(problem="no space")])
    assert not ledger.known(TASK).is_finished
    ledger.add([result()])
    ledger.add([result(problem="no space")])
    assert Ledger(tmp_path, "abc").known(TASK).is_finished
    assert Ledger(tmp_path, "abc").differing([TASK]) == []


@pytest.mark.parametrize("line", ["", "{}", "[]", "null", '{"task": 3}', "\x00\x00", json.dumps({"task": "a"})])
def test_what_is_no_result_is_passed_over(tmp_path, line):
    (tmp_path / RESULTS).write_text(f"{line}\n{result().to_line()}\n", "utf-8")
    assert Ledger(tmp_path, "abc").known(TASK) == result()


def test_two_campaigns_do_not_write_to_one_folder(tmp_path):
    folder = tmp_path / "new" / "folder"
    with opened(folder, "abc"), pytest.raises(InUseError, match="another campaign"), opened(folder, "abc"):
        pass
    with opened(folder, "abc") as ledger:
        ledger.add([result()])


def test_a_folder_that_is_none_is_an_error_of_the_store(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(StoreError, match="file"), opened(tmp_path / "file" / "folder", "abc"):
        pass


def test_infinities_of_results_are_kept(tmp_path):
    ledger = Ledger(tmp_path, "abc")
    ledger.add([result(content=[float("-inf"), float("inf")])])
    assert Ledger(tmp_path, "abc").known(TASK).content == [float("-inf"), float("inf")]


def test_tasks_differ_by_each_of_their_parts():
    others = [
        replace(TASK, key="night 2"), replace(TASK, does="module:other"), replace(TASK, arguments={"seed": 1, "x": 0}),
    ]  # fmt: skip
    assert len({TASK.digest, *(each.digest for each in others)}) == 4
    assert replace(TASK, sort="nights").digest == TASK.digest
