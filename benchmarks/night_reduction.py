"""How long the reduction of a night of an IMU takes at 100 Hz on six channels, beside the least that a script would do.

From counts in memory, which is the analysis alone, and from the file with its frames. The script is given the counts
and takes the mean rate of each channel over each window, without a look at what may be wrong with them. The whole
sequence is run first, which takes a minute or two.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import numpy as np

from bench.app.execute import execute
from bench.app.request import RunRequest, prepare
from bench.clock import Stopwatch
from bench.metrology.acquisition import Counts
from bench.metrology.outputs import windows_of
from bench.reduce.acquisitions import acquisitions
from bench.reduce.evaluate import evaluate
from bench.reduce.journal import journal_records
from bench.reduce.stored_run import open_run
from bench.runner.quiet import Quiet

CONFIG = Path(__file__).parents[1] / "config"
REPEATS = 3


def made(folder: Path) -> Path:
    """The directory of a run."""
    shutil.copytree(CONFIG, folder / "config")
    bench = folder / "config" / "imu_100_hz.yaml"
    bench.write_text((CONFIG / "imu.yaml").read_text("utf-8").replace("period: 100 ms", "period: 10 ms"))
    request = RunRequest("imu_24_position", bench=str(bench), runs=folder / "runs")
    return execute(prepare(request), Quiet()).path


def mean_rate_pps(counts: Counts) -> float:
    """The least that a script would do with counts that wrap."""
    wrap, tick_wrap = (1 << counts.counter_bits) - 1, (1 << counts.tick_bits) - 1
    pulses = (np.diff(counts.positive) & wrap).sum() - (np.diff(counts.negative) & wrap).sum()
    return float(pulses / ((np.diff(counts.tick) & tick_wrap).sum() * counts.tick_period_s))


def in_memory(path: Path) -> tuple[int, float, float]:
    """How many latches there are, and seconds from counts to findings: of the script, and of the analysis."""
    latches, script_s, analysis_s = 0, 0.0, 0.0
    with open_run(path) as stored:
        means = {label: stored.data(label) for entry in stored.sequence.results for label in entry.labels}
        for label in means:
            for acquisition in acquisitions(stored.reader, stored.bench, (), label):
                watch = Stopwatch()
                for counts in acquisition.counts.values():
                    mean_rate_pps(counts)
                script_s += watch.elapsed_s()
                watch = Stopwatch()
                windows_of(acquisition.counts, acquisition.turned)
                analysis_s += watch.elapsed_s()
                latches += max(len(counts.tick) for counts in acquisition.counts.values())
        watch = Stopwatch()
        evaluate(stored.sequence, means.__getitem__, "completed", journal_records(stored.reader))
        return latches, script_s, analysis_s + watch.elapsed_s()


def from_file_s(path: Path) -> float:
    """From a run directory to findings."""
    watch = Stopwatch()
    with open_run(path) as stored:
        stored.evaluate()
    return watch.elapsed_s()


def main() -> None:
    """A line for each of the three."""
    with tempfile.TemporaryDirectory() as name:
        path = made(Path(name))
        tries = [(*in_memory(path), from_file_s(path)) for _ in range(REPEATS)]
    latches, script_s, analysis_s, file_s = map(min, zip(*tries, strict=True))
    print(f"{f'{latches / 1e6:.1f} million latches':<24}{'s':>8}{'ratio':>8}")
    for title, took_s in (("least of a script", script_s), ("analysis", analysis_s), ("from the file", file_s)):
        print(f"{title:<24}{took_s:>8.2f}{took_s / script_s:>8.1f}")


if __name__ == "__main__":
    main()
