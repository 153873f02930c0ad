"""Compare the results of all shipped sequences between two checkouts, each with a `.venv` of its own.

    python -m campaigns.compare_results ../before . [--only tumble_static]

Every sequence runs on its simulated benches with the preset `quick` and seed 1. Values, uncertainties, budgets and
verdicts in `results.json` must be equal; what names a time, a run or a version is left out. Prints a line for each run,
and returns 1 where one differs.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from tests.support.sequences import ELSEWHERE

ELSE = ("simulated",)
RELEASED = {"imu_start_up": ("--calibration", "config/uut/imu_calibration.json")}
VOLATILE = frozenset({"run", "started", "ended", "program", "chain", "head", "elapsed_s"})


def main() -> int:
    """Run the sequences of the first checkout in both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--only", action="append", default=[])
    options = parser.parse_args()
    different = 0
    for sequence in sorted(path.stem for path in (options.before / "sequences").glob("*.yaml")):
        if options.only and sequence not in options.only:
            continue
        for bench in ELSEWHERE.get(sequence, ELSE):
            before, after = (results(each.resolve(), sequence, bench) for each in (options.before, options.after))
            found = list(differences(before, after, ""))
            different += bool(found)
            same = f"{size(before)} values" if isinstance(before, dict) else before
            told = f"DIFFERS: {'; '.join(found[:3])}" if found else f"equal, {same}"
            print(f"{sequence} on {bench}: {told}", flush=True)
    return 1 if different else 0


def results(checkout: Path, sequence: str, bench: str) -> object:
    """The content of `results.json` of a run, or how the run ended without one."""
    with tempfile.TemporaryDirectory() as runs:
        words = ["run", sequence, "--bench", bench, "--seed", "1", "--runs", runs, *RELEASED.get(sequence, ())]
        text = (checkout / "sequences" / f"{sequence}.yaml").read_text("utf-8")
        if "\n  quick:" in text:
            words += ["--preset", "quick"]
        done = subprocess.run(
            [checkout / ".venv/bin/python", "-m", "bench", *words], cwd=checkout, capture_output=True, text=True,
            check=False, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        for path in Path(runs).glob("*/results.json"):
            return json.loads(path.read_text("utf-8"))
    return f"no results, exit code {done.returncode}"


def differences(before: object, after: object, at: str) -> Iterator[str]:
    """Paths at which two contents differ, except for names of a time, a run or a version."""
    if isinstance(before, dict) and isinstance(after, dict):
        for key in sorted({*before, *after} - VOLATILE):
            yield from differences(before.get(key), after.get(key), f"{at}/{key}")
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for number, (one, other) in enumerate(zip(before, after, strict=True)):
            yield from differences(one, other, f"{at}/{number}")
    elif before != after:
        yield f"{at}: {str(before)[:60]} -> {str(after)[:60]}"


def size(content: object) -> int:
    """Number of compared values."""
    if isinstance(content, dict):
        return sum(size(each) for key, each in content.items() if key not in VOLATILE)
    return sum(map(size, content)) if isinstance(content, list) else 1


if __name__ == "__main__":
    sys.exit(main())
