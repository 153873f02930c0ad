"""Errors of the bench from other distributions than those that its budgets are made for, which are normal.

All have the standard deviation that the certificate states: what differs is the form. Within a run each is a constant,
but for `drifting`, where thermometers and the base also change evenly while it goes on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np

from bench.app import drawn
from simulators.physics.table_kinematics import Level
from simulators.units.unit_file import stream
from simulators.world import World

Draw = Callable[[np.random.Generator], float]
DRIFT = 0.1  # of an error, by which it is less when a run begins, and more when it ends

FORMS: dict[str, Draw] = {
    "normal": lambda draws: float(draws.standard_normal()),
    "rectangular": lambda draws: float(draws.uniform(-math.sqrt(3), math.sqrt(3))),  # to the ends of its rectangle
    "at the limit": lambda draws: float(draws.choice([-1.0, 1.0])),  # a whole standard uncertainty off, either way
    "drifting": lambda draws: float(draws.standard_normal()) / math.sqrt(1 + DRIFT**2 / 3),
}


class _Stream:
    """A random stream that gives another distribution where a normal one is asked for."""

    def __init__(self, draws: np.random.Generator, form: Draw) -> None:
        self._draws, self._form = draws, form

    def standard_normal(self) -> float:
        """One value, with a standard deviation of 1."""
        return self._form(self._draws)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._draws, name)


class Drifts:
    """Errors of a world that change evenly over a run: thermometers, and the level of the base."""

    def __init__(self, world: World) -> None:
        self._kinematics = world.kinematics
        single = [each for unit in world.units.values() for each in (unit._thermometer, unit._board_thermometer)]
        single += [unit._thermometer for unit in world.gyros.values()]
        imus = world.imus.values()
        single += [each for unit in imus for each in (*unit._thermometers.values(), unit._board_thermometer)]
        # Without what is drawn from its certificate: here it drifts otherwise.
        self._drawn = [(each, replace(each._errors, drift_c=0.0)) for each in single]
        self._middle_deg = self._kinematics._level.middle_deg

    def go_to(self, share: float) -> None:
        """Let the errors be as they are at a share of the run: -1 at its begin, 1 at its end."""
        for thermometer, errors in self._drawn:
            thermometer._errors = replace(errors, offset_c=errors.offset_c * (1 + DRIFT * share))
        self._kinematics._level = Level(self._middle_deg * (1 + DRIFT * share))
        self._kinematics._at_rest = (), self._kinematics._at_rest[1]  # it was worked out for another level


@contextmanager
def bench_errors(form: str) -> Iterator[None]:
    """Draw the errors of laboratories from a form while it lasts."""
    with mock.patch.object(drawn, "stream", lambda *path: _Stream(stream(*path), FORMS[form])):
        yield
