"""Each mend taken out once: the test that holds it passes with the mend, and fails without it.

`plants.toml` lists the mends: the defect that they keep out, the file, the text of the mend, what stands in its place
without it, and the test.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

from campaigns.trials.rows import Row

ROOT = Path(__file__).resolve().parents[2]
LIST = Path(__file__).with_name("plants.toml")
TREE = (
    "bench",
    "drivers",
    "simulators",
    "tests",
    "campaigns",
    "config",
    "sequences",
    "templates",
    "docs",
    "pyproject.toml",
)
LIMIT_S = 300.0
AT_ONCE = os.cpu_count() or 1


@dataclass(frozen=True)
class Plant:
    """One mend of `file`: `mend` is its text, `without` what replaces it, `test` the pytest node that then fails."""

    line: str
    file: str
    mend: str
    without: str
    test: str

    def taken_out(self, text: str) -> str:
        """The text of the file without the mend; ValueError unless the mend is in it exactly once."""
        if text.count(self.mend) != 1:
            raise ValueError(f"{self.file}: the mend of '{self.line}' is there {text.count(self.mend)} times")
        return text.replace(self.mend, self.without)


def plants() -> list[Plant]:
    """Every listed mend."""
    return [Plant(**each) for each in tomllib.loads(LIST.read_text(encoding="utf-8"))["plant"]]


def trials(scale: float) -> Iterator[Row]:
    """One row for each line, with as many trials as it has mends; at a smaller scale the first mends of the list."""
    listed = plants()
    by_line: dict[str, list[Plant]] = defaultdict(list)
    for plant in listed[: max(1, round(scale * len(listed)))]:
        by_line[plant.line].append(plant)
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(AT_ONCE) as pool:
        trees: SimpleQueue[Path] = SimpleQueue()
        for number in range(AT_ONCE):
            trees.put(_copied(Path(folder) / f"{number}"))
        tried = {line: [pool.submit(_tried, mend, trees) for mend in mends] for line, mends in by_line.items()}
        for line, mends in tried.items():
            problems = [problem for mend in mends if (problem := mend.result())]
            yield Row(line, len(mends), "; ".join(problems) or "red without the mend, green with it", not problems)


def _copied(tree: Path) -> Path:
    """A copy of what the tests need, in a new folder."""
    tree.mkdir()
    for name in TREE:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, tree / name)
    return tree


def _tried(plant: Plant, trees: SimpleQueue[Path]) -> str:
    tree = trees.get()
    try:
        return _problem(plant, tree)
    except RuntimeError as problem:
        return str(problem)
    finally:
        trees.put(tree)


def _problem(plant: Plant, tree: Path) -> str:
    """Problem of the test of a mend; "" if it fails without the mend and passes with it."""
    path = tree / plant.file
    intact = path.read_text(encoding="utf-8")
    try:
        path.write_text(plant.taken_out(intact), encoding="utf-8")
        if _passes(plant.test, tree):
            return f"{plant.test} does not see it"
    except ValueError as problem:
        return str(problem)
    finally:
        path.write_text(intact, encoding="utf-8")
    return "" if _passes(plant.test, tree) else f"{plant.test} fails with the mend"


def _passes(test: str, tree: Path) -> bool:
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-p", "no:xdist", test]
    environment = os.environ | {"PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, timeout=LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"{test} has not ended within {LIMIT_S:g} s") from None
    if done.returncode > 1:  # 1: tests failed; negative: the signal that the mend takes has ended them
        raise RuntimeError(f"{test} cannot be run: {done.stdout.decode()[-500:]}")
    return done.returncode == 0
