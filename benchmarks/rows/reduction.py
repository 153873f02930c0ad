"""P5: the reduction of a night of an inertial unit, six channels at 100 Hz, beside a script with pandas.

The script is given the counts, and finds the mean rate of each channel over each window, without a look at what may be
wrong with them. This program finds the same, with its looks, and from the file all findings with their uncertainties.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.clock import Stopwatch
from bench.metrology.acquisition import Counts
from bench.metrology.outputs import windows_of
from bench.reduce.acquisitions import acquisitions
from bench.reduce.stored_run import StoredRun, open_run
from benchmarks.compared import Row, Side, in_turn
from benchmarks.night import night
from benchmarks.peers import figures, version_of

ROWS = 10_000_000
TIMES = 10
FROM_FILE_S = 3.0
SAME = 1e-9  # relative difference of rates
IN_MEMORY, FROM_FILE = "mean rates of all windows, from counts in memory", "from the file of the run to findings"

Channels = Mapping[str, Counts]


def measure(whole: bool) -> Iterator[Row]:
    """Seconds for 10⁷ rows from memory and from the file; both find the same rates."""
    with tempfile.TemporaryDirectory() as name:
        run, result = night(Path(name), whole).path, Path(name) / "result.json"
        with open_run(run) as stored:
            windows = windows_in(stored)
        count = given_to_pandas(windows, Path(name) / "rows.npy", result)
        theirs: list[dict[str, Any]] = []

        def pandas_s() -> float:
            theirs.append(figures("pandas", "pandas_reduction.py", Path(name) / "rows.npy", result))
            return float(theirs[-1]["memory_s"])

        found = in_turn(
            {"memory": partial(in_memory_s, windows), "pandas": pandas_s, "file": partial(from_file_s, run)}
        )
        compared(windows, json.loads(result.read_text("utf-8"))["rates_pps"])
    scale = ROWS / count
    version = f"pandas {version_of('pandas', 'pandas')}"
    in_memory = side("this program", found["memory"], scale)
    script = side(version, found["pandas"], scale)
    row = Row("P5", f"10⁷ rows of six channels: {IN_MEMORY}", "s", in_memory, (script,), "", f"≥ {TIMES} ×", False)
    yield Row(**{**vars(row), "is_met": row.ratio(script) >= TIMES})
    from_file = side("this program", found["file"], scale)
    parquet = side(f"{version}, Parquet to mean rates only", [each["file_s"] for each in theirs], scale)
    is_met = from_file.value <= FROM_FILE_S
    what = f"10⁷ rows of six channels: {FROM_FILE}"
    yield Row("P5", what, "s", from_file, (parquet,), "", f"≤ {FROM_FILE_S:.0f} s", is_met)


def side(name: str, values: Sequence[float], scale: float) -> Side:
    """Seconds for all rows."""
    return Side(name, "nothing is written", tuple(value * scale for value in values))


def windows_in(stored: StoredRun) -> list[Channels]:
    """The counts of all acquisitions of a run, as they were read."""
    labels = dict.fromkeys(label for entry in stored.sequence.results for label in entry.labels)
    return [each.counts for label in labels for each in acquisitions(stored.reader, stored.bench, (), label)]


def given_to_pandas(windows: Sequence[Channels], path: Path, result: Path) -> int:
    """Write the rows for the script, and how counters wrap; return how many there are."""
    rows = []
    for number, window in enumerate(windows):
        counts = list(window.values())
        columns = [counts[0].tick, *(each.positive for each in counts), *(each.negative for each in counts)]
        rows.append(np.stack([np.full_like(counts[0].tick, number), *columns], axis=1))
    together = np.concatenate(rows)
    np.save(path, together)
    first = next(iter(windows[0].values()))
    wrap = {key: getattr(first, key) for key in ("tick_bits", "counter_bits", "tick_period_s")}
    result.write_text(json.dumps(wrap), "utf-8")
    return len(together)


def in_memory_s(windows: Sequence[Channels]) -> float:
    """Seconds for the mean rates of all windows."""
    watch = Stopwatch()
    for window in windows:
        windows_of(window)
    return watch.elapsed_s()


def from_file_s(run: Path) -> float:
    """Seconds from a run directory to findings."""
    watch = Stopwatch()
    with open_run(run) as stored:
        stored.evaluate()
    return watch.elapsed_s()


def compared(windows: Sequence[Channels], theirs: Sequence[Sequence[float]]) -> None:
    """Raise ArithmeticError unless both have found the same rates."""
    ours = [[each.mean for each in windows_of(window).values()] for window in windows]
    if not np.allclose(ours, theirs, rtol=SAME, atol=SAME):
        raise ArithmeticError("pandas finds other mean rates than this program")
