"""Calibrations of a unit over all benches, their drift, comparisons of runs, and what is due."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, date, datetime, timedelta
from functools import lru_cache
from itertools import groupby
from operator import itemgetter
from typing import Any, NamedTuple

from bench.archive.query import Archive
from bench.clock import wall_utc
from bench.errors import InputError
from bench.station.runs.findings import FindingView
from bench.station.units.history import Calibrated, UnitHistory, history_of, is_comparable, series_key
from bench.station.units.trends import Calibration, drift, e_n, reaches_limit
from drivers.schema.suggest import did_you_mean

_COLUMNS = (
    "id", "uut", "quantity", "name", "value", "unit", "u", "expanded", "low", "high", "u_max", "monthly_drift",
    "verdict", "marginal",
)  # fmt: skip
_OTHERS = ("run", "started", "sequence", "simulated", "result", "conditions", "flags", "shared")
_FINDINGS = f"SELECT {', '.join((*_COLUMNS, *_OTHERS))} FROM findings"  # noqa: S608  constants


def unit_history(archive: Archive, serial: str) -> UnitHistory:
    """Return the history of a unit from all its runs in an archive. Raises InputError if there are none."""
    found = [_calibrated(each) for each in _findings(archive, "uut = ? ORDER BY started, run, id", serial)]
    if not found:
        known = [str(row[0]) for row in archive.query("SELECT DISTINCT uut FROM findings ORDER BY 1").rows]
        raise InputError(f"{archive.destination.url}: no results of a unit '{serial}'{did_you_mean(serial, known)}")
    runs = list(dict.fromkeys(each.run for each in found))
    return history_of(serial, runs, [each for each in found if is_comparable(each.finding)], {})


def _findings(archive: Archive, where: str, *values: str) -> Iterator[dict[str, Any]]:
    yield from archive.query(f"{_FINDINGS} WHERE {where}", values).records()


def _calibrated(row: dict[str, Any]) -> Calibrated:
    finding = FindingView(
        at=json.loads(row["conditions"]), flags=json.loads(row["flags"]), **{name: row[name] for name in _COLUMNS}
    )  # fmt: skip
    key = series_key(row["sequence"], row["result"], row["unit"], simulated=row["simulated"])
    calibration = Calibration(row["started"], row["value"], row["expanded"], json.loads(row["shared"]))
    return Calibrated(key, row["run"], row["sequence"], row["simulated"], finding, calibration)


class Compared(NamedTuple):
    """Result in two runs; `e_n` is the difference by its expanded uncertainty, None if it has none."""

    result: str
    unit: str
    first: float | None
    second: float | None
    e_n: float | None

    @property
    def difference(self) -> float | None:
        """Second minus first."""
        return None if self.first is None or self.second is None else self.second - self.first


def compared(archive: Archive, first: str, second: str) -> list[Compared]:
    """Compare the results of two runs, given by name, UUID or a unique beginning of either. Raises InputError."""
    sides = [
        {(each.key.partition(": ")[2]): each for each in map(_calibrated, _findings(archive, "uuid = ?", run))}
        for run in (run_of(archive, first), run_of(archive, second))
    ]
    return [
        _compared(key, sides[0].get(key), sides[1].get(key)) for key in dict.fromkeys([*sides[0], *sides[1]])
    ]  # fmt: skip


def _compared(key: str, one: Calibrated | None, other: Calibrated | None) -> Compared:
    result, _, unit = key.rpartition(" / ")
    if one is None or other is None:
        return Compared(result, unit, one and one.finding.value, other and other.finding.value, None)
    both = is_comparable(one.finding) and is_comparable(other.finding)
    return Compared(
        result, unit, one.finding.value, other.finding.value,
        e_n(one.calibration, other.calibration) if both else None,
    )  # fmt: skip


def run_of(archive: Archive, given: str) -> str:
    """Return the UUID of a run by its name, its UUID or a unique beginning of either. Raises InputError."""
    found = archive.query(
        "SELECT uuid, run FROM runs WHERE starts_with(run, $1) OR starts_with(uuid, $1) ORDER BY run", [given]
    ).rows
    exact = [row for row in found if given in row]
    if len(exact or found) == 1:
        return str((exact or found)[0][0])
    if found:
        raise InputError(f"'{given}' is ambiguous: {', '.join(str(row[1]) for row in found[:5])}")
    raise InputError(f"{archive.destination.url}: there is no run '{given}'; 'bench archive query' lists them")


class Due(NamedTuple):
    """What is to be calibrated again: an instrument by its certificate, or a result of a unit by its drift."""

    when: date
    what: str
    why: str


_DUE = """
SELECT last.maker, last.model, last.serial, last.certificate, last.due, last.run FROM (
  SELECT arg_max(instruments, started) AS last FROM instruments WHERE NOT simulated AND serial <> ''
  GROUP BY maker, model, serial) WHERE last.due <= ? ORDER BY last.due
"""
_DUE_SIMULATED = _DUE.replace("NOT simulated AND ", "")


def due(archive: Archive, days: int, *, simulated: bool = False) -> list[Due]:
    """Return the instruments and units that are due within some days, the earliest first.

    Certificates of instruments are those of their last runs. A unit is due when the expanded uncertainty of its drift
    may reach a limit; units with fewer than two calibrations have none. Simulated ones count if asked for.
    """
    until = wall_utc().date() + timedelta(days=days)
    rows = archive.query(_DUE_SIMULATED if simulated else _DUE, [until]).rows
    found = [
        Due(when, f"{maker} {model} {serial}".strip(), f"certificate {certificate}, used in {run}")
        for maker, model, serial, certificate, when, run in rows
    ]
    return sorted([*found, *_units_due(archive, until, simulated=simulated)])


_LIMITED = """
SELECT uut, sequence, simulated, result, unit, started, value, expanded, shared, quantity, low, high FROM findings
WHERE (low IS NOT NULL OR high IS NOT NULL) AND verdict IS DISTINCT FROM 'INVALID' AND expanded > 0
  AND (? OR NOT simulated)
ORDER BY uut, sequence, simulated, result, unit, started, run
"""
_OF_SERIES = 5  # columns that calibrations of one series have in common


def _units_due(archive: Archive, until: date, *, simulated: bool) -> Iterator[Due]:
    """Yield each unit with a result that may reach its limit until then, and the name of its first such result."""
    for serial, of_unit in groupby(archive.each(_LIMITED, [simulated]), key=itemgetter(0)):
        series = (list(rows) for _, rows in groupby(of_unit, key=itemgetter(slice(_OF_SERIES))))
        when, quantity = min((_reaches_limit(rows), str(rows[-1][9])) for rows in series)
        if when.date() <= until:
            yield Due(when.date(), str(serial), f"{quantity} may reach its limit by its drift")


def _reaches_limit(rows: Sequence[Sequence[Any]]) -> datetime:
    """Return when a series may reach the limits of its last calibration; the last instant there is if never."""
    found = drift([Calibration(at, value, expanded, _shared(text)) for *_, at, value, expanded, text, _, _, _ in rows])
    return (found and reaches_limit(found, *rows[-1][-2:])) or datetime.max.replace(tzinfo=UTC)


@lru_cache(maxsize=4096)
def _shared(text: str) -> Mapping[str, float]:
    found: Mapping[str, float] = json.loads(text)
    return found
