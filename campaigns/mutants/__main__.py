"""Mutation scores: `python -m campaigns.mutants [REGION …] [--minutes 60] [--again] [--far] [--keep]`, as root.

Needs mutmut, which is no part of the environment of development: `pip install --target build/mutants/tool --no-deps
mutmut libcst`. A mutant is a change of one function in a copy of the checkout in /tmp; the tests should notice it.
Results are appended to build/mutants/results.jsonl, so that a campaign goes on where it was stopped. --again tries
those once more that have survived, --far lets them meet all near tests and then the far ones, as a changed file.
--keep enters the scores in campaigns/mutants/results.tsv.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from itertools import count
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
HERE, BUILD = Path(__file__).parent, ROOT / "build" / "mutants"
REGIONS: Mapping[str, Mapping[str, Any]] = tomllib.loads((HERE / "regions.toml").read_text("utf-8"))
SEED, FAR_LIMIT_S = 1, 600.0
CONTROL = 25  # mutants, after which the same tests meet the code as it is
OPTIONS = ("-q", "-n", "0", "-p", "no:cacheprovider")
_WRITTEN = count(1)
sys.path.append(str(BUILD / "tool"))

from campaigns.mutants.mutants import Mutant, mutants_of  # noqa: E402  found where it was installed
from campaigns.mutants.sandbox import BROKEN, TIMED_OUT, contained  # noqa: E402
from campaigns.mutants.warm import Warm  # noqa: E402


def mutants_in(region: Mapping[str, Any]) -> list[Mutant]:
    """Return the mutants of a region in the order in which they are tried, which depends on nothing but themselves."""
    files = sorted({str(each.relative_to(ROOT)) for name in region["files"] for each in ROOT.glob(name)})
    return sorted((each for file in files for each in mutants_of(ROOT, file)), key=lambda each: each.place(SEED))


def results() -> dict[str, dict[str, Any]]:
    """Return the last result of each mutant, by key."""
    file = BUILD / "results.jsonl"
    lines = file.read_text("utf-8").splitlines() if file.exists() else []
    return {each["key"]: each for each in map(json.loads, lines)}


def equivalents() -> dict[str, str]:
    """Return why a mutant cannot be noticed, by key."""
    lines = (HERE / "equivalent.tsv").read_text("utf-8").splitlines()[1:]
    return {key: why for key, _, why in (line.split("\t") for line in lines)}


def copied(region: str) -> Path:
    """Return a copy of the checkout, whose tests may take as long as they like."""
    folder = Path(f"/tmp/mutants-{region.replace(' ', '-')}")
    for old in (folder, f"{folder}.tmp"):
        shutil.rmtree(old, ignore_errors=True)
    listed = subprocess.run(["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True)
    for name in filter(lambda name: (ROOT / name).is_file(), listed.stdout.splitlines()):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, folder / name)
    budget = folder / "tests" / "support" / "budget.py"
    budget.write_text(budget.read_text("utf-8").replace("MARGIN = 2.0", "MARGIN = 1e9"), "utf-8")
    return folder


def as_a_file(folder: Path, mutant: Mutant, region: Mapping[str, Any]) -> int:
    """Return 0 if all near and far tests pass with the mutant as a changed file of the copy."""
    path, before = folder / mutant.file, (folder / mutant.file).read_bytes()
    path.write_text(mutant.code(), "utf-8")
    seconds = time.time() + 2 * next(_WRITTEN)  # compiled files are known by size and second
    os.utime(path, (seconds, seconds))
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-x",
        *OPTIONS,
        f"--basetemp={folder}.tmp",
        *region["near"],
        *region["far"],
    ]
    with Path(f"{folder}.txt").open("w", encoding="utf-8") as told:
        status = contained(
            lambda: subprocess.run(command, cwd=folder, stdout=told, stderr=told).returncode, FAR_LIMIT_S
        )
    path.write_bytes(before)
    return status


def carry_on(region: str, until_s: float, *, again: bool, far: bool) -> None:
    """Try the mutants of a region that have no result yet; with `again` also those that have survived."""
    known, outcome = equivalents(), {key: each["outcome"] for key, each in results().items()}
    wanted = {None, "survived"} if again else {None}
    sample = mutants_in(REGIONS[region])[: REGIONS[region].get("sample")]
    left = [each for each in sample if each.key not in known and outcome.get(each.key) in wanted]
    folder = copied(region)
    os.environ["PYTHONPATH"] = sys.path[0] = str(folder)

    shown = os.dup(2)  # pytest keeps what is written to the other

    def one_by_one(warm: Warm | None = None) -> None:
        for number, mutant in enumerate(left):
            if time.monotonic() > until_s:
                return
            began_s = time.monotonic()
            tests = [] if warm is None else warm.through(mutant)
            if warm is None:
                status = as_a_file(folder, mutant, REGIONS[region])
            else:
                status = warm.tried(mutant, tests) if tests else 0
                if number % CONTROL == 0 and warm.tried(mutant._replace(code=(folder / mutant.file).read_text), tests):
                    raise RuntimeError(f"tests fail without a mutant, see {folder}.txt")
            if status == BROKEN:
                raise RuntimeError("a mutant cannot be tried; root may make the namespaces that it needs")
            result = {0: "survived", TIMED_OUT: "timeout"}.get(status, "killed")
            with (BUILD / "results.jsonl").open("a", encoding="utf-8") as file:
                file.write(json.dumps({**mutant.fields(), "outcome": result, "far": far}, ensure_ascii=False) + "\n")
            took_s = time.monotonic() - began_s
            os.write(shown, f"{result} {took_s:.1f} s {mutant.file}:{mutant.line} {mutant.change[:100]}\n".encode())

    if far:
        one_by_one()
    else:
        os.chdir(folder)
        options = [*OPTIONS, "-m", "not slow", "-o", "timeout=30", "--tb=native", f"--basetemp={folder}.tmp"]
        pytest.main([*options, *REGIONS[region]["near"]], plugins=[Warm(folder, one_by_one)])
        os.chdir(ROOT)


def scores(regions: Sequence[str]) -> Iterator[str]:
    """Yield a row of the table for each region that has been tried; what is equivalent is not counted."""
    known, found, today = equivalents(), results(), datetime.now().astimezone().date()
    commit = subprocess.run(["git", "describe", "--always"], cwd=ROOT, capture_output=True, text=True).stdout.strip()
    for region in regions:
        every = [each.key for each in mutants_in(REGIONS[region])]
        keys = every[: REGIONS[region].get("sample")]
        counts = Counter(found[key]["outcome"] for key in keys if key in found and key not in known)
        noticed, equivalent = counts["killed"] + counts["timeout"], sum(key in known for key in keys)
        share = f"{100 * noticed / counts.total():.1f}" if counts else ""
        yield "\t".join(map(str, [region, today, commit, len(every), noticed, counts["survived"], equivalent, share]))


def main() -> int:
    """Exit status 0 whatever the scores are."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("regions", nargs="*", metavar="REGION", help=", ".join(REGIONS))
    parser.add_argument("--minutes", type=float, default=0.0, help="how long to go on; without, only the scores")
    parser.add_argument("--again", action="store_true", help="also those that have survived")
    parser.add_argument("--far", action="store_true", help="those that have survived, with the far tests")
    parser.add_argument("--keep", action="store_true", help="enter the scores in the repository")
    options = parser.parse_args()
    regions, until_s = options.regions or list(REGIONS), time.monotonic() + 60 * options.minutes
    BUILD.mkdir(parents=True, exist_ok=True)
    for region in regions if options.minutes else ():
        carry_on(region, until_s, again=options.again or options.far, far=options.far)
    rows = "".join(f"{row}\n" for row in scores(regions))
    if options.keep:
        with (HERE / "results.tsv").open("a", encoding="utf-8") as file:
            file.write(rows)
    sys.stdout.write(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
