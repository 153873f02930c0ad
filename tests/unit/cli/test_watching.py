"""Lines of `bench watch`, whatever is in a journal."""

from bench.cli.queueing import code_of
from bench.cli.watching import _entry_text, state_text


def test_an_entry_is_one_printable_line_without_lists():
    entry = {
        "at_s": 3.5,
        "kind": "step_ended",
        "step": "a",
        "data": {"x": 1.23456789, "t": "\x1b[2J\n", "n": "", "l": [1]},
    }
    assert _entry_text(entry).split(maxsplit=2)[-1] == "step ended a  x 1.23457, t \ufffd[2J"


def test_a_question_and_a_pause_stand_in_the_line():
    state = {
        "done": 2, "total": 5, "steps": ["soak"], "held_by": ["pause"],
        "questions": [{"text": "Ready?", "expected": "yes"}],
        "readings": [{"name": "t", "value": 20.0, "unit": "°C"}, {"name": "u", "value": None, "unit": "V"}],
    }  # fmt: skip
    assert state_text(state) == "2 of 5 steps done  soak  held by pause  ASKS: Ready? (yes)  t 20 °C"


def test_the_exit_code_of_an_item_is_that_of_its_run():
    item = {"state": "ended", "reason": "", "verdict": "FAIL"}
    assert [code_of(item | more) for more in ({}, {"verdict": "PASS"}, {"verdict": None})] == [1, 0, 3]
    assert code_of(item | {"reason": "supply could not be made safe"}) == 6
    assert [code_of(item | {"state": state}) for state in ("refused", "cancelled")] == [2, 4]
