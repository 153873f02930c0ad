"""Kind `monte-carlo`: after GUM supplement 1 (JCGM 101), the scatter of results beside the uncertainties they state.

The trials are those of the suite, in blocks with seeds of their own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.campaign.tasks import Known, Task
from bench.errors import InputError
from drivers.schema.suggest import did_you_mean
from tests.support.monte_carlo import WITHIN, Rows
from tests.truth.monte_carlo import (
    test_monte_carlo_channel,
    test_monte_carlo_ladder,
    test_monte_carlo_range,
    test_monte_carlo_repeatability,
    test_monte_carlo_response,
    test_monte_carlo_start_up,
)

Draws = Callable[..., Rows]
TRIALS: Mapping[str, Draws] = {
    "range of a gyro": test_monte_carlo_range.gyros,
    "range of an accelerometer": test_monte_carlo_range.centrifuges,
    "response of a gyro": test_monte_carlo_response.gyros,
    "response of an accelerometer": test_monte_carlo_response.accelerometers,
    "thresholds": lambda count, seed: test_monte_carlo_ladder.errors_of(
        test_monte_carlo_ladder.ladders(1e-6, count, seed)
    ),
    "repeatability": test_monte_carlo_repeatability.trials,
    "start-up": test_monte_carlo_start_up.trials,
    "channel": test_monte_carlo_channel.trials,
}
BLOCK = 100  # draws of a task
FIRST_SEED = 1000  # beyond those of the suite


@dataclass(frozen=True)
class Sums:
    """Numbers of errors, and the sums of the squares of these and of their standard uncertainties."""

    values: int = 0
    errors: float = 0.0
    uncertainties: float = 0.0

    def __add__(self, other: Sums) -> Sums:
        return Sums(self.values + other.values, self.errors + other.errors, self.uncertainties + other.uncertainties)

    @property
    def ratio(self) -> float:
        """Scatter over uncertainty, both in the root mean square."""
        return math.sqrt(self.errors / self.uncertainties)


@dataclass(frozen=True)
class MonteCarlo:
    """Campaign of so many draws of each of some trials."""

    names: Sequence[str]
    draws: int
    name: str = "monte-carlo"

    def tasks(self, known: Known) -> Sequence[Task]:
        """Blocks of draws."""
        return [task for name in self.names for task in self._blocks(name)]

    def lines(self, known: Known, out: Path) -> Iterator[str]:
        """A line for each quantity, and those that are not within their bar."""
        for name in self.names:
            yield from ("", name)
            for quantity, sums in self._sums(name, known).items():
                yield f"{quantity:<40} n {sums.values:>6}  scatter/u {sums.ratio:6.3f}"
        problems = list(self._problems(known))
        yield from ("", *(problems or ["monte-carlo: ok"]))

    def exit_code(self, known: Known) -> int:
        """Return 1 if the scatter of a quantity is not within 10 % of its uncertainty."""
        return 1 if any(self._problems(known)) else 0

    def _problems(self, known: Known) -> Iterator[str]:
        for name in self.names:
            for quantity, sums in self._sums(name, known).items():
                if abs(sums.ratio - 1) > WITHIN:
                    yield f"{name}: {quantity} {sums.ratio:.3f}"

    def _blocks(self, name: str) -> Iterator[Task]:
        for number, first in enumerate(range(0, self.draws, BLOCK)):
            count = min(BLOCK, self.draws - first)
            arguments = {"name": name, "count": count, "seed": FIRST_SEED + number}
            yield Task(f"{name} {first + 1}-{first + count}", "campaigns.kinds.monte_carlo:drawn", arguments, name)

    def _sums(self, name: str, known: Known) -> Mapping[str, Sums]:
        found: dict[str, Sums] = {}
        for task in self._blocks(name):
            result = known(task)
            if result is not None and result.is_finished:
                for quantity, sums in result.content.items():
                    found[quantity] = found.get(quantity, Sums()) + Sums(*sums)
        return found


def campaign(*, trials: Sequence[str], draws: int) -> MonteCarlo:
    """The campaign of a command line; no names stand for all. Raises InputError for an unknown one."""
    for each in trials:
        if each not in TRIALS:
            raise InputError(f"--only {each}: unknown, expected {', '.join(TRIALS)}{did_you_mean(each, TRIALS)}")
    return MonteCarlo(trials or list(TRIALS), draws)


def drawn(name: str, count: int, seed: int) -> Mapping[str, Sequence[float]]:
    """Sums of so many draws of a trial, by quantity."""
    rows = TRIALS[name](count, seed=seed)
    return {quantity: [len(each), *np.sum(np.square(each), axis=0).tolist()] for quantity, each in rows.items()}
