"""The campaigns, whole: `python -m campaigns.night [PART …] [--minutes 120] [--again]`, by hand or at night.

Each command of a part writes what it prints to a file of its own in build/night/<date>, and results.tsv there has a
line for each that has ended. Stopped, a night goes on where it was as long as the code is the same: what has passed is
not repeated, what has failed is. Other code, --again, and a night after one that has passed begin a new folder.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
KEPT = ROOT / "build" / "night"

ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",  # threads cost twice what they gain on matrices as small as these
    "PYTHONUNBUFFERED": "1",  # a line is seen when it is printed
}

# A name, and the words after `python -m`. Those of `bench campaign` go on where they were by themselves, and are done
# by workers: two processes here, or the cluster of --scheduler.
PARTS: Mapping[str, Mapping[str, str]] = {
    "faults": {"faults": "bench campaign wires --trials 20000 --out build/campaign/wires"},  # seven minutes
    "trials": {"trials": "campaigns.trials"},
    "hostile": {"hostile": "campaigns.hostile --count 100000"},
    "truth": {
        "monte_carlo": "bench campaign monte-carlo --draws 1500 --out build/campaign/monte-carlo",
        "truth": "bench campaign truth --seeds 40 --decide 400 --out build/campaign/truth",  # hours
    },
    "reliability": {"reliability": "campaigns.reliability --minutes {minutes:g}"},
}


class Ended(NamedTuple):
    """A line of results.tsv: what has ended, when it began, how long it took, its exit status, and of which code."""

    name: str
    began: str
    took_s: str
    status: str
    code: str


class Night:
    """One folder of results."""

    def __init__(self, folder: Path, code: str) -> None:
        self.folder, self._code = folder, code
        self._file = folder / "results.tsv"

    def ended(self) -> dict[str, Ended]:
        """Commands that have ended, by name; of each the last time."""
        if not self._file.exists():
            return {}
        lines = self._file.read_text("utf-8").splitlines()[1:]
        return {each.name: each for each in (Ended(*line.split("\t")) for line in lines)}

    def is_of(self, code: str) -> bool:
        """True if it was begun with this code; nothing has ended in a folder without results."""
        return all(each.code == code for each in self.ended().values())

    def passed(self, name: str) -> bool:
        """True if a command has ended without an error."""
        ended = self.ended().get(name)
        return ended is not None and ended.status == "0"

    def run(self, name: str, command: Sequence[str]) -> None:
        """Run a command; what it prints goes to the console and into its file."""
        self.folder.mkdir(parents=True, exist_ok=True)
        began, began_s = datetime.now().astimezone().isoformat(timespec="seconds"), time.monotonic()
        with (
            (self.folder / f"{name}.txt").open("w", encoding="utf-8") as file,
            subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT,
                env={**os.environ, **ENVIRONMENT},
            ) as process,
        ):  # fmt: skip
            assert process.stdout is not None
            for line in process.stdout:
                sys.stdout.write(line)
                file.write(line)
        took_s = f"{time.monotonic() - began_s:.0f}"
        header = "" if self._file.exists() else "\t".join(Ended._fields) + "\n"
        with self._file.open("a", encoding="utf-8") as file:
            file.write(header + "\t".join(Ended(name, began, took_s, str(process.returncode), self._code)) + "\n")


def night(names: Sequence[str], code: str, kept: Path = KEPT, *, again: bool = False) -> Night:
    """The last night where it has something left of these with this code, otherwise a new one."""
    folders = sorted(each for each in kept.glob("*") if each.is_dir())
    last = Night(folders[-1], code) if folders else None
    if last is not None and not again and last.is_of(code) and not all(last.passed(name) for name in names):
        return last
    return Night(kept / datetime.now().astimezone().strftime("%Y-%m-%d_%H%M%S"), code)


def code_of_now() -> str:
    """The commit, and a digest of what was changed since."""
    commit = _git("describe", "--always").strip()
    changed = _git("diff", "HEAD")
    return f"{commit}+{hashlib.sha256(changed.encode()).hexdigest()[:8]}" if changed else commit


def _git(*arguments: str) -> str:
    return subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, text=True, check=True).stdout


def commands(parts: Sequence[str], minutes: float, scheduler: str = "") -> Iterator[tuple[str, list[str]]]:
    """The name of each command of the parts, and its arguments."""
    for part in parts:
        for name, arguments in PARTS[part].items():
            module, *options = arguments.format(minutes=minutes).split()
            if module == "bench" and scheduler:
                options += ["--scheduler", scheduler]
            yield name if name == part else f"{part}_{name}", [sys.executable, "-m", module, *options]


def spend(found: Night, every: Mapping[str, Sequence[str]]) -> int:
    """Run what has not passed; 1 when something has failed."""
    for name, command in every.items():
        if not found.passed(name):
            sys.stdout.write(f"\n{name}: {' '.join(command[1:])}\n")
            sys.stdout.flush()
            found.run(name, command)
    ended = found.ended()
    sys.stdout.write(f"\n{found.folder}\n")
    for name in every:
        result = "ok" if found.passed(name) else f"FAILED, see {name}.txt"
        sys.stdout.write(f"  {name:<20} {ended[name].took_s:>6} s  {result}\n")
    return 0 if all(found.passed(name) for name in every) else 1


def main() -> int:
    """Exit status 1 when a campaign has failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "parts", nargs="*", metavar="PART", help=f"{', '.join(PARTS)}; without, all of them",
        choices=[*PARTS, []],  # argparse makes an empty list of none
    )  # fmt: skip
    parser.add_argument("--minutes", type=float, default=0.0, help="how long the trials of reliability go on")
    parser.add_argument("--scheduler", default="", metavar="URL", help="of a cluster, as `bench campaign` takes it")
    parser.add_argument("--again", action="store_true", help="begin a new night")
    options = parser.parse_args()
    every = dict(commands(options.parts or list(PARTS), options.minutes, options.scheduler))
    return spend(night(list(every), code_of_now(), again=options.again), every)


if __name__ == "__main__":
    sys.exit(main())
