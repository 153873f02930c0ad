"""Temperatures: set point → chamber air → case → sensor → thermometer, stepped exactly (equations 8.3).

    air      a'' = w²(s - a) - 2 z w a'          s the active set point, ramped by the controller
    case     tau_c c' = a + limit cycle - c + heating
    sensor   tau_s T' = c - T
    reading  tau_m m' = T - m                    the thermometer at the unit
    board    tau_b b' = a + limit cycle - b      of a converter in the chamber, with a thermometer of its own

The system is linear and its input is a straight line between two commands, so one matrix exponential takes it over any
interval without error, independent of the times of the calls.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from simulators.physics.chamber_failures import Failure, Line, failing_target

Matrix = NDArray[np.float64]

_AIR, _AIR_RATE, _CYCLE, _CYCLE_RATE, _SET_POINT, _SET_POINT_RATE = range(6)
_FIRST_UNIT = 6
_PER_UNIT = 4  # case, sensor, thermometer, heating
_PER_BOARD = 2  # board, thermometer; those of all units follow after all units
PROPAGATORS_KEPT = 4096
DOOR_SHARE = 0.5
_TERMS = 20  # of the series for a matrix of norm 1: the first one left out is 2e-20
_STEPS_PER_S = 1000  # intervals are whole milliseconds, so that a few matrices serve a whole night


@dataclass(frozen=True, slots=True)
class ChamberPhysics:
    """Response of the chamber's air to its set point; the limit cycle is a sine of the given r.m.s."""

    start_c: float = 20.0
    natural_period_s: float = 360.0
    damping: float = 0.5
    limit_cycle_c: float = 0.2
    limit_cycle_period_s: float = 90.0


@dataclass(frozen=True, slots=True)
class UnitPhysics:
    """Thermal response of a unit to the air; `board_s` is for a converter in the chamber."""

    case_s: float
    sensor_s: float
    self_heating_c: float
    thermometer_s: float
    board_s: float | None = None


class Thermal:
    """The chamber and the units in it; times are true seconds and never go back."""

    def __init__(self, chamber: ChamberPhysics, units: tuple[UnitPhysics, ...], cycle_phase_rad: float) -> None:
        self._units = units
        self._doublings = [_one_step(chamber, units)]
        self._propagators: dict[int, Matrix] = {}
        self._ticks = 0
        self._ramp_end_s = 0.0
        self._target_c = chamber.start_c
        self._door_effect_c = 0.0  # effect of an open door on the target of the air
        self._failing: tuple[Failure, float] | None = None  # and temperature of the room
        self._commanded = Line(chamber.start_c, 0.0, chamber.start_c, math.inf)
        amplitude, turn = chamber.limit_cycle_c * math.sqrt(2), 2 * math.pi / chamber.limit_cycle_period_s
        self._boards = _boards(units)
        state = np.zeros(_FIRST_UNIT + _PER_UNIT * len(units) + _PER_BOARD * len(self._boards))
        state[[_AIR, _SET_POINT]] = chamber.start_c
        state[_CYCLE] = amplitude * math.cos(cycle_phase_rad)
        state[_CYCLE_RATE] = -amplitude * turn * math.sin(cycle_phase_rad)
        for index in range(len(units)):
            state[_FIRST_UNIT + _PER_UNIT * index : _FIRST_UNIT + _PER_UNIT * index + 3] = chamber.start_c
        state[_FIRST_UNIT + _PER_UNIT * len(units) :] = chamber.start_c
        self._state: list[float] = state.tolist()  # single values are read far more often than all are advanced

    @property
    def now_s(self) -> float:
        """Time up to which temperatures are computed."""
        return self._ticks / _STEPS_PER_S

    def advance(self, to_s: float) -> None:
        """Compute all temperatures up to `to_s`."""
        while True:
            end_s = min(to_s, self._ramp_end_s) if self._state[_SET_POINT_RATE] else to_s
            ticks = round(end_s * _STEPS_PER_S) - self._ticks
            if ticks > 0:
                self._state = (self._propagator(ticks) @ np.array(self._state)).tolist()
                self._ticks += ticks
            if not self._state[_SET_POINT_RATE] or to_s < self._ramp_end_s:
                return
            self._state[_SET_POINT], self._state[_SET_POINT_RATE] = self._target_c + self._door_effect_c, 0.0

    def ramp(self, target_c: float, rate_c_per_s: float) -> None:
        """Ramp the active set point to `target_c` at `rate_c_per_s`; infinity jumps."""
        self._commanded = Line(self.set_point_c, self.now_s, target_c, rate_c_per_s if rate_c_per_s > 0 else math.inf)
        if self._failing is None:
            self._draw(target_c, rate_c_per_s)
        else:
            self._apply_failure(*self._failing)

    def fail(self, failure: Failure | None, room_c: float) -> None:
        """Drive the air by a failure in a room of that temperature; None repairs the chamber."""
        if failure is not None:
            self._failing = failure, room_c
            self._apply_failure(failure, room_c)
        elif self._failing is not None:
            set_point_c, self._failing = self.set_point_c, None
            self._draw(set_point_c, math.inf)
            self._draw(self._commanded.target_c, self._commanded.rate_c_per_s)

    def _apply_failure(self, failure: Failure, room_c: float) -> None:
        self._draw(*failing_target(failure, self._commanded, self._air_target_c, room_c))

    def _draw(self, target_c: float, rate_c_per_s: float) -> None:
        """Drive the air linearly to `target_c`, as the set point does without a failure."""
        distance = target_c - self._air_target_c
        self._target_c = target_c
        self._state[_SET_POINT_RATE] = 0.0
        if distance and math.isfinite(rate_c_per_s) and rate_c_per_s > 0:
            self._state[_SET_POINT_RATE] = math.copysign(rate_c_per_s, distance)
            self._ramp_end_s = self.now_s + abs(distance) / rate_c_per_s
        else:
            self._state[_SET_POINT] = target_c + self._door_effect_c

    def door(self, room_c: float | None) -> None:
        """Open the door, which pulls the air towards the room by DOOR_SHARE of the difference; None closes it."""
        effect_c = 0.0 if room_c is None else DOOR_SHARE * (room_c - self.air_c)
        self._state[_SET_POINT] += effect_c - self._door_effect_c
        self._door_effect_c = effect_c

    def power(self, unit: int, on: bool) -> None:
        """Switch the self-heating of a unit."""
        self._state[_FIRST_UNIT + _PER_UNIT * unit + 3] = self._units[unit].self_heating_c if on else 0.0

    @property
    def set_point_c(self) -> float:
        """Active set point."""
        return self._air_target_c if self._failing is None else self._commanded.at(self.now_s)

    @property
    def _air_target_c(self) -> float:
        """Target of the air, without the effect of the door."""
        return self._state[_SET_POINT] - self._door_effect_c

    @property
    def air_c(self) -> float:
        """Air temperature at the chamber's own sensor."""
        return self._state[_AIR] + self._state[_CYCLE]

    def case_c(self, unit: int) -> float:
        """Case temperature of a unit."""
        return self._state[_FIRST_UNIT + _PER_UNIT * unit]

    def board_c(self, unit: int) -> float:
        """Temperature of the converter board of a unit that has it in the chamber."""
        return self._state[self._boards[unit]]

    def board_thermometer_c(self, unit: int) -> float:
        """Temperature of an ideal thermometer with lag at that board."""
        return self._state[self._boards[unit] + 1]

    def board_rate_c_per_s(self, unit: int) -> float:
        """Rate of that board's temperature."""
        lag_s = self._units[unit].board_s or math.inf
        return (self.air_c - self.board_c(unit)) / lag_s

    def sensor_c(self, unit: int) -> float:
        """Temperature of the sensor inside a unit."""
        return self._state[_FIRST_UNIT + _PER_UNIT * unit + 1]

    def thermometer_c(self, unit: int) -> float:
        """Temperature of an ideal thermometer with lag at the unit."""
        return self._state[_FIRST_UNIT + _PER_UNIT * unit + 2]

    def sensor_rate_c_per_s(self, unit: int) -> float:
        """Rate of the sensor temperature inside a unit."""
        first = _FIRST_UNIT + _PER_UNIT * unit
        return (self._state[first] - self._state[first + 1]) / self._units[unit].sensor_s

    def _propagator(self, ticks: int) -> Matrix:
        """Transition matrix over `ticks` milliseconds: product of those over powers of two, made by squaring."""
        found = self._propagators.get(ticks)
        if found is None:
            if len(self._propagators) > PROPAGATORS_KEPT:
                self._propagators.clear()
            found = self._propagators[ticks] = _power(self._doublings, ticks)
        return found


def _boards(units: tuple[UnitPhysics, ...]) -> dict[int, int]:
    """Index in the state of each unit's board, by the number of the unit."""
    first = _FIRST_UNIT + _PER_UNIT * len(units)
    with_board = [index for index, unit in enumerate(units) if unit.board_s is not None]
    return {index: first + _PER_BOARD * number for number, index in enumerate(with_board)}


def _power(doublings: list[Matrix], ticks: int) -> Matrix:
    product: Matrix | None = None
    for bit in range(ticks.bit_length()):
        if bit == len(doublings):
            doublings.append(doublings[-1] @ doublings[-1])
        if ticks >> bit & 1:
            product = doublings[bit] if product is None else doublings[bit] @ product
    if product is None:
        raise ValueError("no time passes")
    return product


@lru_cache(maxsize=32)
def _one_step(chamber: ChamberPhysics, units: tuple[UnitPhysics, ...]) -> Matrix:
    """Transition matrix of one step; read-only."""
    step = exponential(_system(chamber, units) / _STEPS_PER_S)
    step.setflags(write=False)
    return step


def exponential(matrix: Matrix) -> Matrix:
    """Return the exponential of a matrix: its series for a part so small that it converges, squared to the whole."""
    # that of scipy.linalg, which imports a tenth of all modules of a run, is less accurate for far couplings
    halvings = max(0, math.frexp(float(np.abs(matrix).sum(axis=0).max()))[1])
    part, unity = matrix / 2**halvings, np.eye(len(matrix))
    found = unity
    for order in range(_TERMS, 0, -1):
        found = unity + part @ found / order
    for _ in range(halvings):
        found = found @ found
    return found


def _system(chamber: ChamberPhysics, units: tuple[UnitPhysics, ...]) -> Matrix:
    """System matrix M of z' = M z; inputs are states that are constant or change linearly."""
    boards = _boards(units)
    size = _FIRST_UNIT + _PER_UNIT * len(units) + _PER_BOARD * len(boards)
    matrix = np.zeros((size, size))
    omega, cycle = 2 * math.pi / chamber.natural_period_s, 2 * math.pi / chamber.limit_cycle_period_s
    matrix[_AIR, _AIR_RATE] = 1
    matrix[_AIR_RATE, [_SET_POINT, _AIR, _AIR_RATE]] = omega**2, -(omega**2), -2 * chamber.damping * omega
    matrix[_CYCLE, _CYCLE_RATE] = 1
    matrix[_CYCLE_RATE, _CYCLE] = -(cycle**2)
    matrix[_SET_POINT, _SET_POINT_RATE] = 1
    for index, unit in enumerate(units):
        case = _FIRST_UNIT + _PER_UNIT * index
        sensor, thermometer, heating = case + 1, case + 2, case + 3
        matrix[case, [_AIR, _CYCLE, case, heating]] = np.array([1, 1, -1, 1]) / unit.case_s
        matrix[sensor, [case, sensor]] = np.array([1, -1]) / unit.sensor_s
        matrix[thermometer, [sensor, thermometer]] = np.array([1, -1]) / unit.thermometer_s
        if unit.board_s is not None:
            board = boards[index]
            matrix[board, [_AIR, _CYCLE, board]] = np.array([1, 1, -1]) / unit.board_s
            matrix[board + 1, [board, board + 1]] = np.array([1, -1]) / unit.thermometer_s
    return matrix
