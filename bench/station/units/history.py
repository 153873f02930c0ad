"""History of a unit: every result over its calibrations, and what follows from it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ConfigDict, Field

from bench.errors import StoreError
from bench.station.runs.findings import RESULTS, FindingView, read_findings
from bench.station.units.control_chart import LEAST, RULES, control_chart
from bench.station.units.trends import Calibration, change, drift, e_n, reaches_limit
from bench.store.runs import BENCH_COPY, SEQUENCE_COPY, RunSummary

NEW_EACH_RUN = re.compile(r"^fixture\b|\.drift$|/")  # shared by results of one run, but not by runs
READABLE = ("completed", "failed")


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True)


class ChangeView(_Model):
    """Change of a result since the calibration before, against the drift that its sequence specified."""

    value: float
    expanded: float
    allowed: float = Field(description="a month of the specified drift for each month between, at least one")
    within: bool | None = Field(description="null: the uncertainty of the change reaches over what is allowed")


class PointView(_Model):
    """Result of one calibration; `e_n` compares it with the one before."""

    run: str
    at: datetime
    value: float
    expanded: float
    low: float | None
    high: float | None
    verdict: str | None
    e_n: float | None = None
    change: ChangeView | None = Field(None, description="against the drift that the calibration before specifies")
    signals: list[str] = Field([], description="rules of the control chart that it completes")


class DriftView(_Model):
    """Drift per year by the calibrations, with the covariance of the errors that they share."""

    per_year: float
    expanded: float
    significant: bool
    fits: bool = Field(description="False if the values scatter more than their uncertainties explain")
    chi_squared: float
    dof: int
    reaches_limit: datetime | None = Field(None, description="when value ± U may reach a limit; null: not in ten years")


class ChartView(_Model):
    """Control chart of individual values."""

    centre: float
    low: float
    high: float
    baseline: int
    rules: dict[str, str]


class SeriesView(_Model):
    """One result of a unit over its calibrations, the oldest first."""

    key: str
    sequence: str
    simulated: bool
    quantity: str
    name: str
    at: dict[str, Any] = Field(description="its conditions")
    unit: str
    points: list[PointView]
    drift: DriftView | None = None
    chart: ChartView | None = None
    shared: list[str] = Field([], description="errors that the last two calibrations share")


class UnitHistory(_Model):
    """All calibrations of a serial number."""

    uut: str
    runs: list[str] = Field(description="runs of the unit, newest first")
    series: list[SeriesView]
    next_due: datetime | None = Field(None, description="earliest instant at which a result may reach its limit")
    next_due_by: str = Field("", description="quantity of that result")
    unread: dict[str, str] = Field({}, description="runs without results that can be read, and why")


class Calibrated(NamedTuple):
    """Result of a unit in one run, with the errors that other runs share; results of one `key` are comparable."""

    key: str
    run: str
    sequence: str
    simulated: bool
    finding: FindingView
    calibration: Calibration


def history(uut: str, runs: Iterable[RunSummary]) -> UnitHistory:
    """Return the history of a unit from all runs."""
    of_unit = sorted((run for run in runs if uut in run.units), key=lambda run: run.id)
    found: list[Calibrated] = []
    unread: dict[str, str] = {}
    for run in of_unit:
        try:
            found += _findings(run, uut)
        except StoreError as problem:
            unread[run.id] = str(problem)
    return history_of(uut, [run.id for run in of_unit], found, unread)


def history_of(uut: str, runs: Sequence[str], found: Iterable[Calibrated], unread: dict[str, str]) -> UnitHistory:
    """Return the history of a unit from its results; `runs` and results have the oldest first."""
    series: dict[str, list[Calibrated]] = {}
    for each in found:
        series.setdefault(each.key, []).append(each)
    shown = [_series(key, of_key) for key, of_key in series.items()]
    due = [
        (each.drift.reaches_limit, each.quantity)
        for each in shown
        if each.drift is not None and each.drift.reaches_limit is not None
    ]
    next_due, by = min(due, default=(None, ""))
    return UnitHistory(
        uut=uut, runs=list(reversed(runs)), series=shown, next_due=next_due,
        next_due_by=by, unread=unread,
    )  # fmt: skip


def _findings(run: RunSummary, uut: str) -> Iterator[Calibrated]:
    """Yield the valid findings of a unit in a run. Raises StoreError."""
    if run.state not in READABLE:
        raise StoreError(f"the run is {run.state}")
    found, places = _kept_findings(str(run.path), str(run.manifest.get("ended", "")))
    begun = datetime.fromisoformat(str(run.manifest["started"]))
    sequence, simulated = str(run.manifest.get("sequence", "")), bool(run.manifest.get("simulated"))
    identities = Identities(run.manifest)
    for each in found:
        if each.uut == uut and is_comparable(each):
            key = series_key(sequence, without_place(each.id, places), each.unit, simulated=simulated)
            yield Calibrated(key, run.id, sequence, simulated, each, calibration_of(begun, each, identities))


def is_comparable(finding: FindingView) -> bool:
    """True if a finding is valid and has an uncertainty."""
    return finding.verdict != "INVALID" and finding.expanded > 0.0


def series_key(sequence: str, result: str, unit: str, *, simulated: bool) -> str:
    """Return what comparable results have in common; `result` is the id of a finding without its place."""
    return f"{sequence}{' (simulated)' if simulated else ''}: {result} / {unit}"


@lru_cache(maxsize=256)
def _kept_findings(folder: str, _ended: str) -> tuple[list[FindingView], Mapping[str, str]]:
    return read_findings(Path(folder) / RESULTS)


def without_place(id_: str, places: Iterable[str]) -> str:
    """Return the id of a finding without the place of its unit: the same result, wherever the unit was."""
    label, _, rest = id_.partition("/")
    place, slash, tail = rest.partition("/")
    return f"{label}/{tail}" if slash and place in set(places) else id_


class Identities(dict[str, str | None]):
    """Identity of the error of each device in the runs of a manifest, as text; None if it is not known."""

    def __init__(self, manifest: Mapping[str, Any]) -> None:
        super().__init__()
        hashes = manifest.get("hashes", {})
        self._instruments, self._bench = manifest.get("instruments", {}), hashes.get(BENCH_COPY)
        self._how = [hashes.get(SEQUENCE_COPY), manifest.get("parameters")]

    def __missing__(self, device: str) -> str | None:
        who = self._instruments.get(device)
        if who is None:
            identity = self._bench
        elif who.get("serial"):
            identity = [who.get("maker"), who.get("model"), who["serial"], who.get("calibration")]
        else:
            identity = None
        self[device] = json.dumps([identity, self._how], sort_keys=True) if identity is not None else None
        return self[device]


def calibration_of(at: datetime, finding: FindingView, identities: Identities) -> Calibration:
    """Return a finding as a calibration, with the errors that other runs may share."""
    return Calibration(at, finding.value, finding.expanded, dict(shared_errors(identities, finding)))


def shared_errors(identities: Identities, finding: FindingView) -> Iterator[tuple[str, float]]:
    """Yield the errors of a finding that are the same in each run of the same instruments, with their identity.

    They are the type B lines of the budget that results of one run share, such as `head.zero`. Their identity is the
    line, the sequence with its parameters, which decide how an error enters a result, and the instrument: its serial
    number and certificate; for what is no instrument, such as the site, the bench file. A drift within a run, the error
    of another result, and the level of the fixture, on which units are mounted anew, differ in each run. Where it is
    not certain that an error is the same, it counts as another one, which makes the uncertainty of a difference larger.
    """
    for line in finding.budget:
        if line.type != "B" or line.shared is None or NEW_EACH_RUN.search(line.shared):
            continue
        identity = identities[line.shared.partition(".")[0]]
        if identity is not None:
            yield f"{line.source} of {identity}", line.u


def _series(key: str, found: list[Calibrated]) -> SeriesView:
    last = found[-1]
    calibrations = [each.calibration for each in found]
    chart = control_chart([each.value for each in calibrations])
    signals: dict[int, list[str]] = {}
    for each in chart.signals if chart is not None else ():
        signals.setdefault(each.number, []).append(each.rule)
    points = [
        PointView(
            run=each.run, at=each.calibration.at, value=each.finding.value, expanded=each.finding.expanded,
            low=each.finding.low, high=each.finding.high, verdict=each.finding.verdict, signals=signals.get(n, []),
            e_n=e_n(calibrations[n - 1], calibrations[n]) if n else None,
            change=_change(found[n - 1], each) if n else None,
        )
        for n, each in enumerate(found)
    ]  # fmt: skip
    finding = last.finding
    return SeriesView(
        key=key, sequence=last.sequence, simulated=last.simulated,
        quantity=finding.quantity, name=finding.name, at=finding.at, unit=finding.unit, points=points,
        drift=_drift(calibrations, finding), chart=_chart(chart), shared=_shared(calibrations),
    )  # fmt: skip


def _change(before: Calibrated, now: Calibrated) -> ChangeView | None:
    """Change against the drift that the earlier calibration specifies; None without one."""
    if before.finding.monthly_drift is None:
        return None
    found = change(before.calibration, now.calibration, before.finding.monthly_drift)
    return ChangeView(value=found.value, expanded=found.expanded, allowed=found.allowed, within=found.is_within)


def _shared(calibrations: list[Calibration]) -> list[str]:
    if len(calibrations) < 2:
        return []
    both = calibrations[-1].shared.keys() & calibrations[-2].shared.keys()
    return sorted({name.partition(" of ")[0] for name in both})


def _drift(calibrations: list[Calibration], last: FindingView) -> DriftView | None:
    found = drift(calibrations)
    if found is None:
        return None
    return DriftView(
        per_year=found.per_year, expanded=found.expanded, significant=found.is_significant, fits=found.fits,
        chi_squared=found.chi_squared, dof=found.dof, reaches_limit=reaches_limit(found, last.low, last.high),
    )  # fmt: skip


def _chart(found: Any) -> ChartView | None:
    if found is None:
        return None
    return ChartView(centre=found.centre, low=found.low, high=found.high, baseline=LEAST, rules=RULES)
