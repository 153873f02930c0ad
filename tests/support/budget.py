"""A pytest plugin: processor time of each folder of tests beside its budget in tests/budget.toml.

Processor time is that of this process and of the children it has waited for, because a busy machine makes tests longer
but costs them little of it. A slower machine makes it longer too, and so does a measurement of coverage, in all
folders: each is compared with the median of all, and one that costs more than MARGIN times its budget fails the run.
Where few folders are run, nothing shows the speed of the machine, and their budgets are shown only.

As a program, `python -m tests.support.budget PART`, it prints the folders that have tests of a part.
"""

from __future__ import annotations

import os
import sys
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

import pytest

TESTS = Path(__file__).parents[1]
BUDGETS: dict[str, dict[str, float]] = tomllib.loads((TESTS / "budget.toml").read_text(encoding="utf-8"))
MARGIN = 2.0
MANY = 5  # folders at least, for their median to be a measure of the machine's speed

Spent = dict[str, dict[str, float]]  # part (a table of budget.toml) -> test -> processor seconds


def pytest_configure(config: pytest.Config) -> None:
    """Count in every process, and report in the one that starts the others."""
    config.pluginmanager.register(_Budget(config))


def folder_of(test: str, part: str) -> str | None:
    """Return the longest folder of the table that contains a test, given by its id."""
    path = test.partition("::")[0]
    return max((name for name in BUDGETS[part] if path.startswith(f"tests/{name}/")), key=len, default=None)


def above(spent: Spent) -> list[str]:
    """Return a line for each folder that has cost too much, where the machine's speed is known, or has no budget."""
    lines, pace = [], pace_of(spent)
    for part, tests in spent.items():
        for folder, seconds in _by_folder(tests, part).items():
            if folder is None:
                without = next(test for test in tests if folder_of(test, part) is None)
                lines.append(f"{without} is in no folder of [{part}] in tests/budget.toml; give its folder a budget")
            elif pace is not None and seconds > MARGIN * pace * BUDGETS[part][folder]:
                lines.append(
                    f"tests/{folder} ({part}) took {seconds:.0f} s of processor time of {BUDGETS[part][folder]:g} s: "
                    "make its tests cheaper (--durations=20 lists the longest), or give it more in tests/budget.toml"
                )
    return lines


def pace_of(spent: Spent) -> float | None:
    """Return how much longer than their budgets folders take here, at least 1; None if few are run."""
    shares = [
        seconds / BUDGETS[part][folder]
        for part, tests in spent.items()
        for folder, seconds in _by_folder(tests, part).items()
        if folder is not None
    ]
    return max(1.0, median(shares)) if len(shares) >= MANY else None


def _by_folder(tests: dict[str, float], part: str) -> dict[str | None, float]:
    sums: dict[str | None, float] = defaultdict(float)
    for test, seconds in tests.items():
        sums[folder_of(test, part)] += seconds
    return sums


def _processor_s() -> float:
    return sum(os.times()[:4])


class _Budget:
    """Processor time of the tests of this process, and of those of its workers."""

    def __init__(self, config: pytest.Config) -> None:
        self.config = config
        self.spent: Spent = {part: {} for part in BUDGETS}

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        begun_s = _processor_s()
        result = yield
        part = "slow" if "slow" in item.keywords else "not-slow"
        self.spent[part][item.nodeid] = _processor_s() - begun_s
        return result

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        for part, tests in node.workeroutput.get("spent", {}).items():
            self.spent[part].update(tests)

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if hasattr(self.config, "workeroutput"):
            self.config.workeroutput["spent"] = self.spent
        elif above(self.spent) and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        terminalreporter.section("processor time of folders, and their budgets")
        for part, tests in self.spent.items():
            for folder, seconds in sorted(_by_folder(tests, part).items(), key=str):
                budget = f"{BUDGETS[part][folder]:5g}" if folder else "   no"
                terminalreporter.line(f"{seconds:7.1f} s of {budget} s  tests/{folder} ({part})")
        every = {test: seconds for tests in self.spent.values() for test, seconds in tests.items()}
        for test in sorted(every, key=every.__getitem__, reverse=True)[: self.config.getoption("durations") or 0]:
            terminalreporter.line(f"{every[test]:7.2f} s  {test}")
        for line in above(self.spent):
            terminalreporter.line(line, red=True)


if __name__ == "__main__":
    print(*(f"tests/{name}" for name in BUDGETS[sys.argv[1]]))
