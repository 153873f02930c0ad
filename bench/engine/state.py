"""State of a run as a fold over its journal: the engine updates it with each entry that it writes.

Reading the journal again gives the same state. The values that expressions see are part of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

from bench.sequence.language.expressions import Value
from drivers.quantity.quantities import Quantity
from drivers.quantity.units import parse_unit


class Entry(Protocol):
    """An entry of a journal."""

    @property
    def kind(self) -> str:
        """Kind of the event."""

    @property
    def step(self) -> str:
        """Step in which it occurred; "" outside steps."""

    @property
    def data(self) -> Mapping[str, Any]:
        """Data of the event."""


class Tared(NamedTuple):
    """The mean that later measurements subtract, and its standard uncertainty from scatter."""

    value: float
    scatter: float


NONE: Mapping[str, Any] = MappingProxyType({})


class RunState(NamedTuple):  # each step changes it twice, which takes a frozen dataclass several times as long
    """State of a run: steps in progress and done, measured values, holds and problems.

    `held` are the reasons why no step begins. `left_out` are steps that were skipped, or failed and were passed over.
    `limits_failed` are measurements outside their limits, and those that could not be decided are `undecided`. `mount`
    is the present mounting of the units. `dropped` are units that take no further part, by place, and why. `lost` is
    the number of latches or samples lost in all acquisitions, by DEVICE.CHANNEL.
    """

    under_way: tuple[str, ...] = ()
    done: int = 0
    variables: Mapping[str, Value] = NONE
    tares: Mapping[str, Tared] = NONE
    held: frozenset[str] = frozenset()
    left_out: tuple[str, ...] = ()
    limits_failed: tuple[str, ...] = ()
    undecided: tuple[str, ...] = ()
    dropped: Mapping[str, str] = NONE
    problems: tuple[str, ...] = ()
    questions: tuple[str, ...] = ()
    mount: str | None = None
    lost: Mapping[str, int] = NONE


def replayed(entries: Iterable[Entry]) -> RunState:
    """State after the entries of a journal."""
    state = RunState()
    for entry in entries:
        state = advanced(state, entry.kind, entry.step, entry.data)
    return state


def advanced(  # noqa: C901  one case for each kind
    state: RunState, kind: str, step: str, data: Mapping[str, Any]
) -> RunState:
    """State after one more entry; kinds of entries without effect on it leave it unchanged."""
    match kind:
        case "step_begins":
            return state._replace(under_way=(*state.under_way, step))
        case "step_ended":
            return _ended(_without(state, step, done=state.done + 1), step, data)
        case "step_failed" | "step_cut" | "answered" | "unanswered":
            return _without(state, step)
        case "left_out":
            return state._replace(left_out=(*state.left_out, step))
        case "held":
            return state._replace(held=state.held | {str(data["by"])})
        case "released":
            return state._replace(held=state.held - {str(data["by"])})
        case "asked":
            return state._replace(questions=(*state.questions, step))
        case "unit_dropped":
            return state._replace(dropped={**state.dropped, str(data["place"]): str(data["text"])})
        case "gaps":
            return state._replace(lost=_more_lost(state.lost, data))
        case "run_resumed":
            return state._replace(under_way=(), held=frozenset(), questions=())
        case "problem":
            return state._replace(problems=(*state.problems, str(data["text"])))
        case _:
            return state


def _without(state: RunState, step: str, **changed: Any) -> RunState:
    if step in state.questions:
        changed["questions"] = tuple(other for other in state.questions if other != step)
    under_way = tuple([other for other in state.under_way if other != step])
    return state._replace(under_way=under_way, **changed)


def _more_lost(lost: Mapping[str, int], data: Mapping[str, Any]) -> Mapping[str, int]:
    name = f"{data['device']}.{data['channel']}"
    return {**lost, name: lost.get(name, 0) + int(data["lost"])}


def _ended(state: RunState, step: str, data: Mapping[str, Any]) -> RunState:
    if "as" in data and "value" in data:
        value: Any = data["value"]
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            unit = parse_unit(data["unit"])
            value = Quantity(float(value) * float(unit.factor), unit.dimension)
        state = state._replace(variables={**state.variables, str(data["as"]): value})
    if "mount" in data:
        state = state._replace(mount=str(data["mount"]))
    if "tare" in data:
        tared = Tared(float(data["value"]), float(data.get("scatter", 0.0)))
        state = state._replace(tares={**state.tares, str(data["tare"]): tared})
    if data.get("verdict") == "FAIL":
        return state._replace(limits_failed=(*state.limits_failed, step))
    if data.get("verdict") == "INVALID":
        return state._replace(undecided=(*state.undecided, step))
    return state
