"""Contents of a run's journal for its results: measurements, answers, left-out steps, interruptions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from bench.figures.languages import tr
from bench.figures.numbers import decimals
from bench.figures.times_and_sizes import duration
from bench.metrology.results.coverage import COVERAGE
from bench.metrology.results.finding import Dropped
from bench.sequence.plan.dwells import first_visit
from bench.store.reader import Event, RunReader

Verdict = Literal["PASS", "FAIL", "INVALID"]


@dataclass(frozen=True, slots=True)
class Measurement:
    """One value of a `measure` step, in `unit`; `u` is its standard uncertainty if known."""

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
        """The value with its expanded uncertainty, to significant digits."""
        if self.u is None or self.u == 0:
            return f"{self.value:.6g}"
        digits = decimals(COVERAGE * self.u)
        return f"{self.value:.{digits}f} ± {COVERAGE * self.u:.{digits}f}"

    @property
    def limits_shown(self) -> str:
        """Text of its limits; empty without them."""
        if self.limits is None:
            return ""
        low, high, u_max = (
            None if (limit := self.limits.get(side)) is None else f"{limit:.6g}" for side in ("min", "max", "u_max")
        )
        if low is None:
            sides = "" if high is None else tr("at most {high}", high=high)
        else:
            sides = tr("at least {low}", low=low) if high is None else tr("{low} to {high}", low=low, high=high)
        guard = self.limits.get("guard")
        texts = (
            f"{sides} {self.unit}" if sides else "",
            tr("guard band {k} u", k=f"{guard:g}") if guard else "",
            "" if u_max is None else f"{tr('u at most {u_max}', u_max=u_max)} {self.unit}",
        )
        return tr(", ").join(filter(None, texts))


@dataclass(frozen=True, slots=True)
class Answered:
    """A question, its answer, the person, and the time after the start of the run."""

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
class SoakCredited:
    """Credited part of a soak that was repeated, of `at_least_s`; `why` if there was no credit."""

    step: str
    credit_s: float
    at_least_s: float
    why: str = ""

    @property
    def in_words(self) -> str:
        """Text for a report."""
        if self.why:
            return tr("No credit for the soak {step}: {why}.", step=self.step, why=self.why)
        return tr(
            "Of the soak {step} {credit} of {all} counted as passed: its chamber was held.",
            step=self.step, credit=duration(self.credit_s), all=duration(self.at_least_s),
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Interruption:
    """The loss of the process of a run, and its resumption.

    `after_s` is since the start of the run, `again` are the steps in progress, `restarted` the groups repeated from
    their first step. `is_between` is true if data from before and after it are reduced together, `unstated` are then
    the places of units without a stated repeatability over power cycles, and `of_history` is true if it interrupted a
    temperature profile. `soaks` are those whose credit was decided.
    """

    after_s: float
    outage_s: float
    again: tuple[str, ...]
    restarted: tuple[str, ...]
    is_between: bool
    unstated: tuple[str, ...] = ()
    of_history: bool = False
    soaks: tuple[SoakCredited, ...] = ()

    @property
    def in_words(self) -> str:
        """Text for the first page of a report."""
        text = tr(
            "Interrupted {time} after the start, made safe, and resumed {outage} later.",
            time=duration(self.after_s), outage=duration(self.outage_s),
        )  # fmt: skip
        if self.again:
            text += " " + tr("Under way and done again: {steps}.", steps=", ".join(self.again))
        if self.restarted:
            text += " " + tr("Done again from its first step: {groups}.", groups=", ".join(self.restarted))
        text += "".join(f" {each.in_words}" for each in self.soaks)
        if self.is_between:
            text += " " + tr(
                "The results combine data from before and after it; the unit was without power in between."
            )
        if self.unstated:
            text += " " + tr(
                "No budget contains its repeatability over power cycles: the run is INCOMPLETE. For further runs state "
                "power_cycles in the bench file: {places}.",
                places=", ".join(f"places.{place}" for place in self.unstated),
            )
        elif self.is_between:
            text += " " + tr("Budgets that it concerns contain its repeatability over power cycles.")
        if self.of_history:
            text += " " + tr("The temperature in between was not that of the sequence, which hysteresis contains.")
        return text


@dataclass(frozen=True, slots=True)
class Superseded:
    """An earlier attempt at an acquisition, superseded by a later one; it began `after_s` after the start of the run.

    `ended` is true if it completed, as when its group or an operator repeated it.
    """

    step: str
    attempt: int
    after_s: float
    ended: bool

    @property
    def in_words(self) -> str:
        """Text for a report."""
        return tr(
            "Superseded: attempt {number} of step {step}, begun {time} after the start. Its data are kept in the "
            "record and not used.",
            number=self.attempt, step=self.step, time=duration(self.after_s),
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class JournalRecords:
    """Contents of the journal of a run that are not in its frames; of repeated steps the last execution.

    `dropped` are units that did not take part to the end, by place.
    """

    measurements: tuple[Measurement, ...] = ()
    answers: tuple[Answered, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    dropped: Mapping[str, Dropped] = field(default_factory=dict)
    interruptions: tuple[Interruption, ...] = ()
    superseded: tuple[Superseded, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Part of `results.json`; `interruptions` and `superseded` only if there are any."""
        sometimes: dict[str, tuple[Interruption | Superseded, ...]] = {
            "interruptions": self.interruptions, "superseded": self.superseded,
        }  # fmt: skip
        return {
            **{name: [asdict(each) for each in found] for name, found in sometimes.items() if found},
            "measurements": [asdict(found) | {"limits": found.limits or None} for found in self.measurements],
            "left_out": [asdict(found) for found in self.left_out],
        }


def journal_records(reader: RunReader, unstated: Sequence[str] = ()) -> JournalRecords:
    """Contents of the journal of a run.

    `unstated` are the places of units without a stated repeatability over power cycles.
    """
    measurements: dict[str, Measurement] = {}
    answers: list[Answered] = []
    left_out: list[LeftOut] = []
    dropped: dict[str, Dropped] = {}
    acquired: dict[str, list[str]] = {}
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
        elif "label" in data:
            acquired.setdefault(first_visit(event.step), []).append(event.step)
    interruptions = tuple(_interruptions(reader, began_s, tuple(unstated)))
    superseded = tuple(_superseded(reader, acquired, began_s))
    return JournalRecords(
        tuple(measurements.values()), tuple(answers), tuple(left_out), dropped, interruptions, superseded
    )


def _interruptions(reader: RunReader, began_s: float, unstated: tuple[str, ...]) -> Iterator[Interruption]:
    resumed = list(reader.events("run_resumed"))
    if not resumed:
        return
    ended = list(reader.events("step_ended"))
    acquired_s = {first_visit(event.step): event.at_s for event in ended if "label" in event.data}
    set_points_c = {event.data["set_point_c"] for event in ended if "set_point_c" in event.data}
    soaks = _soaks_credited(reader)
    for event in resumed:
        before = [at_s < event.at_s for at_s in acquired_s.values()]
        is_between = any(before) and not all(before)
        yield Interruption(
            after_s=float(event.data["interrupted_s"]) - began_s,
            outage_s=float(event.data["outage_s"]),
            again=tuple(event.data["interrupted"]),
            restarted=tuple(event.data.get("restarted", ())),
            is_between=is_between,
            unstated=unstated if is_between else (),
            of_history=is_between and len(set_points_c) > 1,
            soaks=soaks.get(event.seq, ()),
        )


def _soaks_credited(reader: RunReader) -> dict[int, tuple[SoakCredited, ...]]:
    """Decisions on soaks after each resumption, by the number of its entry."""
    found: dict[int, tuple[SoakCredited, ...]] = {}
    resumed = -1
    for event in reader.events("run_resumed", "soak_credit"):
        if event.kind == "run_resumed":
            resumed = event.seq
        else:
            data = event.data
            credited = SoakCredited(event.step, data["credit_s"], data["at_least_s"], str(data.get("why", "")))
            found[resumed] = (*found.get(resumed, ()), credited)
    return found


def _superseded(reader: RunReader, acquired: Mapping[str, Sequence[str]], began_s: float) -> Iterator[Superseded]:
    """Attempts at acquisitions before the last one that ended, in order; `acquired` are those that ended, by step."""
    again = {step: complete for step, complete in acquired.items() if complete[-1] != step}
    if not again:
        return
    begun: dict[str, list[Event]] = {step: [] for step in again}
    for event in reader.events("step_begins"):
        if (step := first_visit(event.step)) in begun:
            begun[step].append(event)
    for step, complete in again.items():
        for number, event in enumerate(begun[step], start=1):
            if event.step == complete[-1]:
                break
            yield Superseded(step, number, event.at_s - began_s, event.step in complete)


def _measurement(event: Event) -> Measurement:
    data = event.data
    return Measurement(
        step=event.step, reading=data["reading"], name=data.get("as"), value=data["value"], unit=data["unit"],
        u=data["u"], limits=data.get("limits"), verdict=data.get("verdict"), marginal=data.get("marginal", False),
    )  # fmt: skip


def verdicts_of(found: Sequence[Measurement]) -> set[str]:
    """Verdicts of measurements by their limits."""
    return {measurement.verdict for measurement in found if measurement.verdict is not None}
