"""The state of a run as a fold over its journal."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.engine.state import RunState, Tared, advanced, replayed
from drivers.quantity.quantities import Quantity, parse


class Entry(NamedTuple):
    kind: str
    step: str = ""
    data: Mapping[str, Any] = MappingProxyType({})


UNITS = ["°C", "V", "°", "pulse/s", "", "hPa"]
NAMES = st.sampled_from(["t", "pressure", "side"])
MEASURED = st.builds(
    lambda name, value, unit, verdict: {"as": name, "value": value, "unit": unit, "reading": "r", **verdict},
    NAMES, st.floats(-1e6, 1e6), st.sampled_from(UNITS),
    st.sampled_from([{}, {"verdict": "PASS"}, {"verdict": "FAIL"}, {"verdict": "INVALID"}]),
)  # fmt: skip
CHOSEN = st.builds(lambda name, value: {"as": name, "value": value, "by": "operator"}, NAMES, st.text(max_size=5))
TARED = st.builds(lambda value: {"tare": "counter.x", "value": value, "unit": "pulse/s", "u": None}, st.floats(-9, 9))
FOUND = st.one_of(st.just({}), MEASURED, CHOSEN, TARED, st.just({"label": "a", "begin_s": 0.0, "end_s": 1.0}))
ENDS = st.one_of(
    st.tuples(st.just("step_ended"), FOUND),
    st.tuples(st.just("step_failed"), st.just({"code": "silent", "text": "no answer"})),
    st.tuples(st.just("step_cut"), st.sampled_from([{"wish": "skip"}, {"wish": "end"}])),
)
ELSEWHERE = st.sampled_from(
    [
        Entry("made_safe", data={"unsafe": {}}), Entry("problem", data={"text": "no"}), Entry("fault", data={}),
        Entry("held", "s", {"by": "operator"}), Entry("released", data={"by": "operator"}),
        Entry("left_out", "s", {"text": "", "why": "skipped"}), Entry("what nobody knows", "s", {"value": 1}),
    ]
)  # fmt: skip


@st.composite
def lives(draw):
    """The entries of one step, in their order."""
    name = draw(st.sampled_from(["steps/move", "steps/parallel/a/prompt", "teardown/set", "steps/wait~2"]))
    name = f"{name}#{draw(st.integers(1, 10**9))}"
    entries = [Entry("step_begins", name)]
    if draw(st.booleans()):
        entries.append(Entry("asked", name, {"text": "Ready?", "expected": "done"}))
    kind, data = draw(ENDS)
    entries.append(Entry(kind, name, data))
    if draw(st.booleans()):
        entries.append(Entry("asked", f"{name}?", {"text": "What now?", "expected": "stop"}))
        entries.append(Entry(draw(st.sampled_from(["answered", "unanswered"])), f"{name}?", {"answer": "stop"}))
    return entries


@st.composite
def journals(draw):
    """The entries of several steps, interleaved as they may be, with others between them."""
    waiting = [list(life) for life in draw(st.lists(lives(), max_size=6, unique_by=lambda life: life[0].step))]
    journal = []
    while waiting:
        life = draw(st.sampled_from(waiting))
        journal.append(life.pop(0))
        waiting = [each for each in waiting if each]
        if draw(st.booleans()):
            journal.append(draw(ELSEWHERE))
    return journal


def of(journal, *kinds):
    return [entry for entry in journal if entry.kind in kinds]


@pytest.mark.lengthy
@given(journals())
def test_whatever_the_order_nothing_is_under_way_when_every_step_has_ended(journal):
    state = replayed(journal)
    assert (state.under_way, state.questions) == ((), ())
    assert state.done == len(of(journal, "step_ended"))
    assert len(state.problems) == len(of(journal, "problem"))
    assert len(state.left_out) == len(of(journal, "left_out"))


@given(journals(), st.data())
def test_at_any_time_those_steps_are_under_way_that_have_begun_and_not_ended(journal, data):
    now = data.draw(st.integers(0, len(journal)))
    past = journal[:now]
    begun = [entry.step for entry in of(past, "step_begins")]
    over = {entry.step for entry in of(past, "step_ended", "step_failed", "step_cut")}
    assert replayed(past).under_way == tuple(step for step in begun if step not in over)


@given(journals())
def test_the_newest_value_of_a_name_is_known_in_its_unit(journal):
    state = replayed(journal)
    measured = {entry.data["as"]: entry.data for entry in of(journal, "step_ended") if "as" in entry.data}
    assert state.variables.keys() == measured.keys()
    for name, value in state.variables.items():
        data = measured[name]
        if isinstance(value, Quantity):
            assert value.to(data["unit"]) == pytest.approx(data["value"], rel=1e-12)
        else:
            assert value == data["value"]


@pytest.mark.parametrize(("value", "unit"), [(25.5, "°C"), (1013.25, "hPa"), (-3.0, ""), (11300.0, "pulse/s")])
def test_a_measured_value_is_the_quantity_that_a_document_would_write(value, unit):
    entry = {"as": "t", "value": value, "unit": unit, "reading": "r"}
    assert advanced(RunState(), "step_ended", "a", entry).variables == {"t": parse(f"{value} {unit}".strip())}


def test_a_state_is_not_changed_by_the_one_after_it():
    before = RunState(variables={"t": Quantity(1.0)}, under_way=("a",))
    after = advanced(before, "step_ended", "a", {"as": "t", "value": 2.0, "unit": ""})
    assert (before.variables["t"], before.under_way, before.done) == (Quantity(1.0), ("a",), 0)
    assert (after.variables["t"], after.under_way, after.done) == (Quantity(2.0), (), 1)


def test_verdicts_holds_and_tares_are_kept():
    state = replayed(
        [
            Entry("step_ended", "a", {"verdict": "FAIL"}), Entry("step_ended", "b", {"verdict": "INVALID"}),
            Entry("step_ended", "c", {"verdict": "PASS"}), Entry("held", "d", {"by": "interlock hot"}),
            Entry("held", "d", {"by": "operator"}), Entry("released", "", {"by": "operator"}),
            Entry("step_ended", "e", {"tare": "counter.x", "value": 5.0, "unit": "pulse/s"}),
        ]
    )  # fmt: skip
    assert (state.limits_failed, state.undecided) == (("a",), ("b",))
    assert state.held == {"interlock hot"}
    assert state.tares == {"counter.x": Tared(5.0, 0.0)}
