"""Evaluation of a stored run to `results.json`: reduction by the methods of its sequence, verdicts by its limits."""

from __future__ import annotations

import dataclasses
import datetime as dt
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from bench.metrology.power_cycles import reduced
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Finding, UnitResult
from bench.metrology.results.flag import Flag
from bench.metrology.results.limits import Limits
from bench.metrology.run_data import RunData
from bench.metrology.unlike_nominal import compared_with_nominal
from bench.reduce.gaps import MissedIn
from bench.reduce.journal import JournalRecords, verdicts_of
from bench.sequence.document.model import ResultEntry, SequenceFile
from bench.sequence.method import known_methods
from bench.sequence.steps.limits import limits_in, value_or_ratio
from drivers.installed import loaded

SCHEMA = "itb-results/1"
Verdict = Literal["PASS", "FAIL", "ERROR", "ABORTED", "INCOMPLETE", "NOT JUDGED"]
_ENDED: Mapping[str, Verdict] = {
    "error": "ERROR",
    "aborted": "ABORTED",
    "failed": "FAIL",
    "interrupted": "INCOMPLETE",
    "running": "INCOMPLETE",
}


@dataclass(frozen=True)
class Results:
    """All results of a run, and its verdict.

    `corrections` lists the certificates that corrected readings, `past_due` the expired ones by device or reading, with
    their due dates. `missed` are lost frames.
    """

    title: str
    verdict: Verdict
    units: tuple[UnitResult, ...]
    journal_records: JournalRecords = field(default_factory=JournalRecords)
    corrections: tuple[str, ...] = ()
    past_due: Mapping[str, dt.date] = field(default_factory=dict)
    missed: tuple[MissedIn, ...] = ()

    @property
    def within_u(self) -> int:
        """Number of values with a limit within their U, whose true value may be on the other side of it."""
        return sum(finding.within_u for unit in self.units for finding in unit.findings)

    def to_json(self) -> dict[str, Any]:
        """Content of `results.json`; `missed` only if frames were lost."""
        return {
            "schema": SCHEMA,
            "title": self.title,
            "verdict": self.verdict,
            "units": [_unit(unit) for unit in self.units],
            "findings": [_finding(finding) for unit in self.units for finding in unit.findings],
            "models": [model.to_json() for unit in self.units for model in unit.models],
            "corrections": list(self.corrections),
            "past_due": {name: str(due) for name, due in self.past_due.items()},
            **self.journal_records.to_json(),
            **({"missed": [each.to_json() for each in self.missed]} if self.missed else {}),
        }


def evaluate(
    sequence: SequenceFile, data: Callable[[str], RunData], state: str, from_journal: JournalRecords
) -> Results:
    """Evaluate a run that ended in `state`; its data are reduced even if it did not complete.

    `data` returns the acquisitions under a label.
    """
    units: list[UnitResult] = []
    for entry in sequence.results:
        method = known_methods()[entry.method]
        settings = method.settings.model_validate(entry.settings).model_dump()
        reduce = loaded(method.target)
        found: dict[str, UnitResult] = {}
        acquired = data(entry.data)
        if entry.closure is not None:
            acquired = dataclasses.replace(acquired, closure=data(entry.closure).acquisitions)
        for part in acquired.by_length():
            found |= {unit.place: unit for unit in reduced(reduce, part, settings)}
        for unit in acquired.units:
            dropped = from_journal.dropped.get(unit.place)
            found_of_unit = found[unit.place]
            findings = compared_with_nominal(found_of_unit.findings, unit)
            result = dataclasses.replace(found_of_unit, findings=findings, dropped=dropped)
            circuit_unit = None if unit.circuit is None else unit.circuit.unit
            in_units = method.units(unit.output_unit, unit.gyro_output_unit, circuit_unit)
            units.append(_judged(result, entry, in_units))
    verdict = _verdict(units, sequence, state, from_journal)
    return Results(sequence.title, verdict, tuple(units), from_journal)


def _judged(unit: UnitResult, entry: ResultEntry, quantities: Mapping[str, str]) -> UnitResult:
    limits = {name: limits_in(limit, quantities[name]) for name, limit in entry.limits.items()}
    findings = [
        finding.judged(limits[finding.quantity]) if finding.quantity in limits else finding for finding in unit.findings
    ]
    findings = [_with_drift(each, entry) if each.quantity in entry.monthly_drift else each for each in findings]
    undetermined = [name for name in limits if name not in {finding.quantity for finding in findings}]
    flags = [Flag("not_determined", of=name) for name in undetermined if unit.dropped is None]
    return dataclasses.replace(
        unit,
        findings=tuple(findings),
        left_out=(*unit.left_out, *undetermined),
        flags=(*unit.flags, *flags),
    )


def _with_drift(finding: Finding, entry: ResultEntry) -> Finding:
    """The finding with the specified drift of its quantity."""
    value, ratio = value_or_ratio(finding.unit, entry.monthly_drift[finding.quantity])
    return dataclasses.replace(finding, monthly_drift=abs(finding.value) * (ratio or 0.0) if value is None else value)


def _verdict(
    units: Sequence[UnitResult], sequence: SequenceFile, state: str, journal_records: JournalRecords
) -> Verdict:
    """INCOMPLETE if the run left something out, whatever its other results, as for a unit (equations 1.10).

    Also if its results combine data from before and after an interruption, unless their budgets contain it.

    NOT JUDGED if nothing has a limit.
    """
    ended = _ENDED.get(state)
    if ended is not None and ended != "INCOMPLETE":
        return ended
    verdicts = {unit.verdict for unit in units} | verdicts_of(journal_records.measurements)
    apart = journal_records.left_out or any(each.unstated for each in journal_records.interruptions)
    if ended or apart or verdicts & {"INCOMPLETE", "INVALID"} or (sequence.results and not units):
        return "INCOMPLETE"
    if "FAIL" in verdicts:
        return "FAIL"
    return "PASS" if "PASS" in verdicts else "NOT JUDGED"


def _unit(unit: UnitResult) -> dict[str, Any]:
    """JSON content of a unit by one method; `dropped` only if it was."""
    content = {"place": unit.place, "uut": unit.uut, "verdict": unit.verdict, "flags": list(map(str, unit.flags))}
    return content if unit.dropped is None else {**content, "dropped": dataclasses.asdict(unit.dropped)}


def _finding(finding: Finding) -> dict[str, Any]:
    limits = finding.limits or Limits()
    sides = {key: side for key, side in (("min", limits.low), ("max", limits.high)) if side is not None}
    return {
        "id": finding.id,
        "uut": finding.uut,
        "quantity": finding.quantity,
        "name": finding.name,
        "at": dict(finding.at),
        "value": finding.value,
        "unit": finding.unit,
        "u": finding.u,
        "k": finding.k,
        "expanded": finding.expanded,
        "dof": finding.dof,
        "interval": None if finding.interval is None else dataclasses.asdict(finding.interval),
        "limits": sides or None,
        "guard": limits.guard_k,
        "u_max": limits.u_allowed(finding.value),
        "monthly_drift": finding.monthly_drift,
        "verdict": finding.verdict,
        "marginal": finding.marginal,
        "flags": list(finding.flags),
        "budget": [_line(line) for line in finding.budget],
        "steps": list(finding.steps),
    }


def _line(line: BudgetLine) -> dict[str, Any]:
    return {"source": line.source, "type": line.type, "u": line.u, "dof": line.dof, "shared": line.shared}
