"""Time of questions to an archive of many runs, beside SQLite with an index on the same results.

The runs are synthetic: 20 years of units that are calibrated each half year, with a drift that is known. With --raw
each has a Parquet file of readings as well, so that 100,000 runs are about 10 GB. What is there is not made again.
"""

from __future__ import annotations

import argparse
import json
import sqlite3
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from bench.archive.columns import schema
from bench.archive.destination import Destination
from bench.archive.query import Archive
from bench.archive.tables import Tables
from bench.archive.units import unit_history
from bench.clock import wall_utc

YEARS, PER_YEAR = 20, 2  # calibrations of a unit
RESULTS = 60  # of a run
LINES = 5  # of a budget
BATCHES = 10  # of a year: pushes between two calls of tidy, each of many runs
FIRST = datetime(2006, 1, 2, 8, tzinfo=UTC)
YEAR = timedelta(days=365.25)
READINGS = 12_000  # of a file of raw readings
REPEATS = 7
TREND = "SELECT started, value, expanded FROM findings WHERE uut = ? AND result = 'tumble/K0/0' ORDER BY started"
DRIFTS = """
SELECT count(*), median(slope), quantile_cont(abs(slope), 0.95) FROM (
  SELECT regr_slope(value, epoch(started) / 31557600.0) AS slope FROM findings
  WHERE sequence = 'tumble_static' AND result = 'tumble/K0/0' GROUP BY uut HAVING count(*) > 2)
"""
OF_SQLITE = "SELECT started, value, expanded FROM findings WHERE uut = ? AND result = 'tumble/K0/0' ORDER BY started"


def batches(units: int) -> Iterator[tuple[int, int, list[int], datetime]]:
    """Year, number of the batch, and the units that are calibrated then."""
    for half in range(YEARS * PER_YEAR):
        at = FIRST + half * YEAR / PER_YEAR
        for batch in range(BATCHES):
            begins, ends = batch * units // BATCHES, (batch + 1) * units // BATCHES
            yield half, batch, list(range(begins, ends)), at


def rows(half: int, units: list[int], at: datetime, drifts: np.ndarray) -> dict[str, pa.Table]:
    """Rows of the runs of some units at one date."""
    rng = np.random.default_rng([half, units[0]])
    count = len(units)
    uuids = [f"{unit:08x}-{half:04x}" for unit in units]
    serials = [f"QF-{unit:05}" for unit in units]
    of_run = {
        "uuid": uuids, "version": [1] * count, "run": [f"{at:%Y%m%dT%H%M%SZ}_tumble-static_{each}" for each in serials],
        "started": [at] * count, "year": [at.year] * count, "sequence": ["tumble_static"] * count,
        "simulated": [False] * count,
    }  # fmt: skip
    runs = as_table("runs", count, **of_run, units=serials, verdict=["PASS"] * count, publication=uuids)
    repeated = {name: np.repeat(np.array(values, object), RESULTS) for name, values in of_run.items()}
    number = np.tile(np.arange(RESULTS), count)
    years = half / PER_YEAR
    value = 1e-3 + np.repeat(drifts[units], RESULTS) * years + 1e-6 * rng.standard_normal(count * RESULTS)
    names = np.array([f"tumble/K0/{each}" for each in range(RESULTS)], object)[number]
    findings = as_table(
        "findings", len(value), **repeated, uut=np.repeat(np.array(serials, object), RESULTS), id=names, result=names,
        quantity=["K0"] * len(value), name=["bias"] * len(value), unit=["g"] * len(value), value=value,
        u=np.full(len(value), 1e-6), expanded=np.full(len(value), 2e-6), low=np.full(len(value), -5e-3),
        high=np.full(len(value), 5e-3), conditions=["{}"] * len(value), flags=["[]"] * len(value),
        shared=['{"head: zero of 0123456789abcdef": 9e-07}'] * len(value), marginal=[False] * len(value),
        verdict=["PASS"] * len(value),
    )  # fmt: skip
    lines = {name: np.repeat(values, LINES) for name, values in repeated.items() if name in schema("budgets").names}
    budgets = as_table(
        "budgets", len(value) * LINES, **lines, uut=np.repeat(np.array(serials, object), RESULTS * LINES),
        id=np.repeat(names, LINES), quantity=["K0"] * len(value) * LINES, unit=["g"] * len(value) * LINES,
        source=[f"source {each}" for each in range(LINES)] * len(value), type=["B"] * len(value) * LINES,
        u=rng.random(len(value) * LINES) * 1e-6,
    )  # fmt: skip
    return {"findings": findings, "budgets": budgets, "runs": runs}


def as_table(table: str, count: int, **columns: Any) -> pa.Table:
    """Arrow table with the columns of a table of an archive; those that are not given are null."""
    kinds = schema(table)
    arrays = [
        pa.array(columns[field.name], field.type) if field.name in columns else pa.nulls(count, field.type)
        for field in kinds
    ]
    return pa.Table.from_arrays(arrays, schema=kinds)


def fill(folder: Path, units: int, *, raw: bool) -> Archive:
    """Archive of these units; batches that are there are skipped."""
    destination = Destination(str(folder))
    destination.begin()
    tables, drifts = Tables(destination), np.random.default_rng(1).normal(5e-6, 10e-6, units)
    done = folder / "done.txt"
    known = set(done.read_text().split()) if done.exists() else set()
    for half, batch, chosen, at in batches(units):
        name = f"{half}-{batch}"
        if name in known or not chosen:
            continue
        for table, found in rows(half, chosen, at, drifts).items():
            tables.append(table, found, f"made-{name}")
        if raw:
            for unit in chosen:
                write_raw(folder / "runs" / f"{unit:05}" / f"{half:02}.parquet", half * units + unit)
        with done.open("a") as file:
            file.write(f"{name}\n")
        if batch == BATCHES - 1 and half % 2:
            print(f"{wall_utc():%H:%M:%S} {at.year}: {(half + 1) * units} runs", flush=True)
    if not known.issuperset({"tidy"}):
        print(tables.tidy())
        done.open("a").write("tidy\n")
    return Archive(destination)


def write_raw(path: Path, seed: int) -> None:
    """A file of readings of one run."""
    path.parent.mkdir(parents=True, exist_ok=True)
    values = np.random.default_rng(seed).standard_normal(READINGS)
    pq.write_table(pa.table({"t_s": np.arange(READINGS, dtype=float), "value": values}), path, compression="zstd")


def in_sqlite(folder: Path, archive: Archive) -> sqlite3.Connection:
    """The findings in SQLite, with an index."""
    path = folder / "findings.sqlite"
    is_new = not path.exists()
    connection = sqlite3.connect(path)
    if is_new:
        connection.execute("CREATE TABLE findings (uut, result, started REAL, value REAL, expanded REAL)")
        reader = archive.query("SELECT uut, result, epoch(started), value, expanded FROM findings").rows
        connection.executemany("INSERT INTO findings VALUES (?, ?, ?, ?, ?)", reader)
        connection.execute("CREATE INDEX of_unit ON findings (uut, result)")
        connection.commit()
    return connection


def median_s(work: Callable[[], Any]) -> float:
    """Median of the real time of a work."""
    taken = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        work()
        taken.append(time.perf_counter() - began)
    return statistics.median(taken)


def measured(folder: Path, units: int, *, raw: bool, beside: bool) -> dict[str, float]:
    """Median times in s by question."""
    archive = fill(folder, units, raw=raw)
    serial = f"QF-{units // 2:05}"
    trend = archive.query(TREND, [serial]).rows
    assert len(trend) == YEARS * PER_YEAR
    found = {
        "runs": units * YEARS * PER_YEAR,
        "open_s": median_s(lambda: Archive(archive.destination)),
        "trend_s": median_s(lambda: archive.query(TREND, [serial])),
        "history_s": median_s(lambda: unit_history(archive, serial)),
        "drifts_s": median_s(lambda: archive.query(DRIFTS)),
    }
    if beside:
        with closing(in_sqlite(folder, archive)) as connection:
            found["sqlite_trend_s"] = median_s(lambda: connection.execute(OF_SQLITE, [serial]).fetchall())
    return found


def picture(found: list[dict[str, float]], path: Path) -> None:
    """Draw the times over the number of runs."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.subplots()
    runs = [each["runs"] for each in found]
    names = {
        "trend_s": "trend of one result of a unit",
        "history_s": "all results of a unit",
        "drifts_s": "drift of a type",
    }
    for name, words in names.items():
        axes.loglog(runs, [each[name] for each in found], marker="o", label=words)
    axes.set(xlabel="runs in the archive", ylabel="time / s")
    axes.grid(visible=True, which="both", alpha=0.3)
    axes.legend()
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--runs", type=int, nargs="+", default=[1000, 10_000])
    parser.add_argument("--raw", action="store_true", help="also write a file of readings for each run")
    parser.add_argument("--beside", action="store_true", help="also ask SQLite")
    parser.add_argument("--picture", type=Path, help="draw the times to this file")
    given = parser.parse_args()
    every = []
    for runs in given.runs:
        found = measured(given.folder / str(runs), runs // (YEARS * PER_YEAR), raw=given.raw, beside=given.beside)
        every.append(found)
        print(json.dumps({"day": f"{wall_utc():%Y-%m-%d}", **found}), flush=True)
    if given.picture is not None:
        picture(every, given.picture)


if __name__ == "__main__":
    main()
