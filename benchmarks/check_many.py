"""Time of a check of many sequences in one process, beside one process for each."""

from __future__ import annotations

import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

COUNT = 100
ALONE = 10  # processes that are measured of COUNT
SEQUENCES = ("smoke", "tumble_static", "ramp_dynamic", "threshold_resolution")
ROOT = Path(__file__).parents[1]


def check_s(*words: str) -> tuple[float, float]:
    """Real time and processor time of a check."""
    began_s, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "bench", "check", *words], check=True, capture_output=True, cwd=ROOT)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - began_s, cpu_s


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        for number in range(COUNT):
            name = SEQUENCES[number % len(SEQUENCES)]
            shutil.copy(ROOT / "sequences" / f"{name}.yaml", Path(folder, f"{name}_{number:03}.yaml"))
        files = sorted(map(str, Path(folder).iterdir()))
        check_s(files[0])
        together_s, together_cpu_s = check_s(folder)
        alone = [check_s(file) for file in files[:: COUNT // ALONE]]
    alone_s, alone_cpu_s = (sum(each) / len(alone) for each in zip(*alone, strict=True))
    print(f"{COUNT} sequences in one process: {together_s:.2f} s, {together_cpu_s:.2f} s of processor time")
    print(f"one sequence in a process:      {alone_s:.2f} s, {alone_cpu_s:.2f} s of processor time")
    print(f"{COUNT} processes would take {COUNT * alone_cpu_s / together_cpu_s:.0f} times the processor time of one")
    print(f"largest process: {resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main()
