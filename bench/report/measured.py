"""What a run measured, asked and left out on its way, apart from what its methods reduce."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from bench.analysis.coverage import COVERAGE
from bench.analysis.finding import Dropped
from bench.report.languages import tr
from bench.report.shown import decimals
from bench.sequence.dwells import first_visit
from bench.store.reader import Event, RunReader

Verdict = Literal["PASS", "FAIL", "INVALID"]


@dataclass(frozen=True, slots=True)
class Measurement:
    """One value that a `measure` step took, in `unit`; `u` is its standard uncertainty where that is known."""

    step: str
    reading: str
    name: str | None
    value: float
    unit: str
    u: float | None
    limits: Mapping[str, float | None] | None
    verdict: Verdict | None
    marginal: bool

    @property
    def shown(self) -> str:
        """The value with its expanded uncertainty, in digits that mean something."""
        if self.u is None or self.u == 0:
            return f"{self.value:.6g}"
        digits = decimals(COVERAGE * self.u)
        return f"{self.value:.{digits}f} ± {COVERAGE * self.u:.{digits}f}"

    @property
    def limits_shown(self) -> str:
        """Its limits in words; empty without them."""
        if self.limits is None:
            return ""
        low, high = (None if (limit := self.limits.get(side)) is None else f"{limit:.6g}" for side in ("min", "max"))
        if low is None:
            sides = tr("at most {high}", high=high)
        else:
            sides = tr("at least {low}", low=low) if high is None else tr("{low} to {high}", low=low, high=high)
        guard = self.limits.get("guard")
        return f"{sides} {self.unit}" + (f"{tr(', ')}{tr('guard band {k} u', k=f'{guard:g}')}" if guard else "")


@dataclass(frozen=True, slots=True)
class Answered:
    """A question, its answer, who gave it, and how long after the start of the run."""

    step: str
    question: str
    answer: str
    by: str
    after_s: float


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A step that was skipped, or failed and was passed over."""

    step: str
    why: str


@dataclass(frozen=True, slots=True)
class OnTheWay:
    """Everything of a run that stands in its journal and not in its frames; of a step done again the last time.

    `dropped` are units that did not take part to the end, by place.
    """

    measurements: tuple[Measurement, ...] = ()
    answers: tuple[Answered, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    dropped: Mapping[str, Dropped] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Its part of `results.json`."""
        return {
            "measurements": [
                {
                    "step": found.step, "reading": found.reading, "name": found.name, "value": found.value,
                    "unit": found.unit, "u": found.u, "limits": dict(found.limits) if found.limits else None,
                    "verdict": found.verdict, "marginal": found.marginal,
                }
                for found in self.measurements
            ],
            "left_out": [{"step": found.step, "why": found.why} for found in self.left_out],
        }  # fmt: skip


def on_the_way(reader: RunReader) -> OnTheWay:
    """What the journal of a run holds."""
    measurements: dict[str, Measurement] = {}
    answers: list[Answered] = []
    left_out: list[LeftOut] = []
    dropped: dict[str, Dropped] = {}
    began_s, _ = reader.span_s()
    for event in reader.events("step_ended", "left_out", "answered", "unit_dropped"):
        data = event.data
        if event.kind == "unit_dropped":
            dropped[data["place"]] = Dropped(event.at_s, data["fault"], data["bad"], data["text"])
        elif event.kind == "left_out":
            left_out.append(LeftOut(event.step, str(data["text"] or data["why"])))
        elif event.kind == "answered":
            question = str(data.get("question") or tr("What now?"))
            after_s = event.at_s - began_s
            answers.append(Answered(event.step, question, str(data["answer"]), str(data["by"]), after_s))
        elif "question" in data:
            answer = f"{data['value']} {data.get('unit', '')}".strip()
            after_s = event.at_s - began_s
            answers.append(Answered(event.step, str(data["question"]), answer, str(data["by"]), after_s))
        elif "reading" in data and "u" in data:
            measurements[first_visit(event.step)] = _measurement(event)
    return OnTheWay(tuple(measurements.values()), tuple(answers), tuple(left_out), dropped)


def _measurement(event: Event) -> Measurement:
    data = event.data
    return Measurement(
        step=event.step, reading=data["reading"], name=data.get("as"), value=data["value"], unit=data["unit"],
        u=data["u"], limits=data.get("limits"), verdict=data.get("verdict"), marginal=data.get("marginal", False),
    )  # fmt: skip


def verdicts_of(found: Sequence[Measurement]) -> set[str]:
    """What the limits of measurements say."""
    return {measurement.verdict for measurement in found if measurement.verdict is not None}
