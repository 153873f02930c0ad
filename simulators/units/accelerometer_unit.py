"""An accelerometer with its converter in its place, between the world and the instrument that measures its output."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from simulators.faults.instrument_faults import OPEN_C, FaultPlan
from simulators.physics.attitude import to_unit
from simulators.physics.dynamics import POINTS, Follower, look_at_s
from simulators.physics.input_hysteresis import InputHysteresis, Play
from simulators.physics.noise import Noise
from simulators.units.accelerometer import Hysteresis, Sent, UnitTruth, draw_unit, noise_of
from simulators.units.history import History
from simulators.units.settings import WorldSettings
from simulators.units.surroundings import Surroundings
from simulators.units.unit_file import UnitFile, stream
from simulators.units.unit_temperatures import Board, Thermometer, ThermometerErrors, UnitTemperatures, followed_c

Array = NDArray[np.float64]
Input = Literal["accelerometer", "source"]  # connection of a converter
LOOK_S = 0.02  # time step of a mean current during a motion of the head
LOOK_AT_SWING_S = 0.0005  # time step of hysteresis during an oscillation
HYSTERESIS_STEP_S = 1.0  # time step of temperature, independent of the length of a block


class UnitState(NamedTuple):
    """State of a unit at true times: bias from hysteresis, drift and warm-up, and from the rate of temperature.

    Also the temperatures of its sensor and of an ideal thermometer, the steps of bias and scale factor (relative) by
    the last power-on, and the bias from the history of its input.
    """

    true_s: Array
    drifted_g: Array
    moving_g: Array
    sensor_c: Array
    thermometer_c: Array
    turned_on_g: Array
    turned_on_scale: Array
    by_input_g: Array


class SimulatedUnit:
    """One unit in its place: counts of its converter, and reading of its thermometer."""

    def __init__(self, place: str, file: UnitFile, index: int, settings: WorldSettings, world: Surroundings) -> None:
        self.place = place
        self.settings = settings.places[place]
        self.truth: UnitTruth = draw_unit(file, settings.seed, place)
        self._follower = Follower(self.truth.dynamics) if self.truth.dynamics is not None else None
        self.faults = FaultPlan(now_s=world.now)
        self._index, self._world = index, world
        self.seats_deg: list[
            tuple[float, float]
        ] = []  # true time of each mounting by hand, and the mounting error since
        self._turn_on = stream(settings.seed, "uut", place, "accelerometer", "turn_on")
        self._turn_on_scale = stream(settings.seed, "uut", place, "accelerometer", "turn_on_scale")
        self._turned_on_g, self._turned_on_scale = 0.0, 0.0
        self._noise = noise_of(self.truth, settings.seed, place)
        self._hysteresis = Hysteresis(self.truth, settings.chamber.start_c)
        self._input_hysteresis = self._input_play() if self.truth.input_thresholds_g else None
        start_c = settings.chamber.start_c
        self.temperatures = UnitTemperatures(world.thermal, index, file, start_c, settings.thermometer_lag_s)
        self._thermometer, self._board_thermometer = self._thermometers(settings)
        self.board = Board(self.temperatures)
        self._hysteresis_g = 0.0  # at the end of the last block
        self.powered_at_s: float | None = None
        self.history = History(len(UnitState._fields))
        self.input: Input = "accelerometer"

    def _input_play(self) -> InputHysteresis:
        """Input hysteresis, which follows the input before every change of it."""
        play = Play(self.truth.input_hysteresis_g, self.truth.input_thresholds_g)
        found = InputHysteresis(
            play, lambda at_s: self.truth.sensed_g(self.force_g(at_s)), self._world.moves_until_s,
            LOOK_AT_SWING_S if self.swings else LOOK_S,
        )  # fmt: skip
        self._world.integrate_with(lambda: found.before_change(self._world.now()))
        return found

    def _by_input_g(self, at_s: Array) -> Array:
        """Bias from the history of the input."""
        if self._input_hysteresis is None:
            return np.zeros_like(at_s)
        self._input_hysteresis.follow(self._world.now())
        return self._input_hysteresis.bias_g(at_s)

    def _thermometers(self, settings: WorldSettings) -> tuple[Thermometer, Thermometer]:
        """Thermometers at the unit and at its converter."""
        own = self.settings

        def made(name: str, errors: ThermometerErrors) -> Thermometer:
            noise = stream(settings.seed, "noise", self.place, name)
            return Thermometer(errors, settings.thermometer_noise_c, noise, settings.run_s)

        return made("thermometer", own.thermometer), made("converter thermometer", own.converter_thermometer)

    @property
    def sent(self) -> Sent:
        """Its conversion to codes."""
        return Sent(self.truth.clock, self.truth.zero_code, self.truth.noise_code)

    def power(self, since_s: float | None) -> None:
        """Switch the power on at a time, or off; each power-on steps bias and scale factor by draws of its own."""
        self.powered_at_s = since_s
        if since_s is not None and self.truth.turn_on_g:
            self._turned_on_g = self.truth.turn_on_g * float(self._turn_on.standard_normal())
        if since_s is not None and self.truth.turn_on_scale:
            self._turned_on_scale = self.truth.turn_on_scale * float(self._turn_on_scale.standard_normal())

    def fixed_anew(self, at_s: float) -> None:
        """Mounted anew by hand: draw its mounting angles again."""
        if sd_deg := self._world.settings.remount_deg:
            draw = stream(self._world.settings.seed, "remount", self.place, str(len(self.seats_deg)))
            self.seats_deg.append((at_s, sd_deg * float(draw.standard_normal())))

    @property
    def swings(self) -> bool:
        """True if the input may reverse between two latches."""
        return self._follower is not None

    def charge_pulses(self, edges_s: Array) -> Array:
        """Charge in each interval between the consecutive times `edges_s`, in pulses.

        The world is computed up to the last edge, or less than a latch beyond it.
        """
        current_a, board_c = self._currents_a(edges_s)
        if self.powered_at_s is None or self.faults.active("dead"):
            return np.zeros_like(current_a)
        return self.truth.rate_pps(current_a, board_c) * (edges_s[1:] - edges_s[:-1])

    def mean_codes(self, edges_s: Array) -> Array:
        """Codes of its A/D converter for the mean input in each interval, as in `charge_pulses`; before rounding."""
        current_a, board_c = self._currents_a(edges_s)
        return self.truth.codes(np.zeros_like(current_a) if self.faults.active("dead") else current_a, board_c)

    def _currents_a(self, edges_s: Array) -> tuple[Array, Array | None]:
        """Mean currents of the intervals, 0 without power, and the converter's temperature."""
        middle, interval = (edges_s[1:] + edges_s[:-1]) / 2, edges_s[1:] - edges_s[:-1]
        begin_s, end_s = float(edges_s[0]), float(edges_s[-1])
        course = self.temperatures.course
        temperature, corners_s = course.sensor_c(middle), course.corners_s(begin_s, end_s)
        seconds_s, hysteresis_g = self._followed_g(begin_s, end_s)
        bias_g = np.interp(middle, seconds_s, hysteresis_g) + self.truth.kd * course.rate_c_per_s(middle)
        state = self._state(corners_s[1:], np.interp(corners_s[1:], seconds_s, hysteresis_g))
        self.history.go_on(*state)
        board_c = self.board.followed_c(corners_s, middle, state.drifted_g)
        if self.powered_at_s is None:
            return np.zeros_like(middle), board_c
        noise_g = self._noise.mean(interval)
        if self._follower is None:
            current = self._current_a(middle, temperature, bias_g, noise_g)
        else:
            look_s = look_at_s(edges_s, self.truth.delay_s)
            temperature, bias_g, noise_g = (np.repeat(each, len(POINTS)) for each in (temperature, bias_g, noise_g))
            looked_at = self._current_a(look_s.ravel(), temperature, bias_g, noise_g)
            current = self._follower.mean(looked_at.reshape(look_s.shape), interval)
        if self.input == "source":
            current = self._world.source_a(self.settings.source, middle)
        return current, board_c

    def _followed_g(self, begin_s: float, end_s: float) -> tuple[Array, list[float]]:
        """Bias from hysteresis at times from the begin to the end, about a second apart."""
        seconds_s = np.linspace(begin_s, end_s, 1 + math.ceil((end_s - begin_s) / HYSTERESIS_STEP_S))
        course_c = self.temperatures.course.sensor_c(seconds_s[1:])
        followed_g = [self._hysteresis_g, *self._hysteresis.follow(course_c.tolist())]
        self._hysteresis_g = followed_g[-1]
        return seconds_s, followed_g

    def mean_volts(self, begin_s: float, end_s: float, noise: Noise, load_ohm: float) -> float:
        """Mean voltage of its current across a load from `begin_s` to `end_s`; 0 without power.

        The world is computed up to the end, or less than a reading beyond it. Each observer has a `noise` of its own,
        so that its readings do not affect those of others.
        """
        hysteresis_g = self._hysteresis.bias_g(self.temperatures.sensor_c)
        now_s = self._world.thermal.now_s
        state = self._state(np.array([now_s]), np.array([hysteresis_g]))
        if not self.settings.channel:  # only this object keeps its history
            self.history.go_on(*state)
        board_c = self.board.just_before_c(now_s, now_s - (begin_s + end_s) / 2, float(state.drifted_g[0]))
        if self.powered_at_s is None:
            return 0.0
        edges_s = np.linspace(begin_s, end_s, 1 + math.ceil((end_s - begin_s) / LOOK_S))
        middle, interval = (edges_s[1:] + edges_s[:-1]) / 2, edges_s[1:] - edges_s[:-1]
        since_s = middle - now_s
        temperature = self.temperatures.sensor_c + since_s * self.temperatures.sensor_rate_c_per_s
        bias_g = hysteresis_g + float(state.moving_g[0])
        current_a = self._current_a(middle, temperature, bias_g, noise.mean(interval))
        if self.input == "source":
            current_a = self._world.source_a(self.settings.source, middle)
        return float(self.truth.volts(current_a.mean(), load_ohm, board_c))

    def own_noise(self, name: str) -> Noise:
        """An independent copy of its noise, so that the readings of one observer do not affect those of another."""
        return noise_of(self.truth, self._world.settings.seed, f"{self.place}/{name}")

    def _state(self, at_s: Array, hysteresis_g: Array) -> UnitState:
        """State at times for the bias from hysteresis at these."""
        course, by_input_g = self.temperatures.course, self._by_input_g(at_s)
        drifted_g = hysteresis_g + by_input_g + self._slow_bias_g(at_s)
        moving_g = self.truth.kd * course.rate_c_per_s(at_s)
        stepped = np.full_like(at_s, self._turned_on_g), np.full_like(at_s, self._turned_on_scale)
        warm_c = course.sensor_c(at_s), course.thermometer_c(at_s)
        return UnitState(at_s, drifted_g, moving_g, *warm_c, *stepped, by_input_g)

    def _current_a(self, at_s: Array, temperature_c: Array, bias_g: Array | float, noise_g: Array) -> Array:
        drifting = self._slow_bias_g(at_s) + bias_g
        if self._input_hysteresis is not None:
            drifting = drifting + self._by_input_g(at_s)
        current_a = self.truth.current_a(self.force_g(at_s), temperature_c, drifting + noise_g)
        return current_a * (1 + self._turned_on_scale)

    def _slow_bias_g(self, at_s: Array) -> Array:
        """Drift, step of the last power-on and, while powered, warm-up at the times `at_s`."""
        drift = self.truth.drift_g_per_s * at_s + self._turned_on_g
        if self.powered_at_s is None:
            return drift
        return drift + self.truth.warm_up_g * np.exp((self.powered_at_s - at_s) / self.truth.warm_up_s)

    def force_g(self, at_s: Array) -> tuple[Array, Array, Array]:
        """Specific force along the input, pendulous and output axes, in local g."""
        seat_deg = self.seats_deg[-1][1] if self.seats_deg else 0.0
        force = self._world.kinematics.force_g(at_s, self.settings.arm_m)
        x, y, z = to_unit(self._world.mount, self.settings.mount_angle_deg + seat_deg, self.settings.clock_deg) @ force
        return x, z, y

    def thermometer_c(self, at_s: Array) -> Array:
        """Readings of the thermometer at the unit at times since the last call, with its errors and noise."""
        true_c = followed_c(self.faults, self.temperatures.course.thermometer_c(at_s), self._world.settings.ambient_c)
        read_c = self._thermometer.readings_c(at_s, true_c)
        return np.full_like(read_c, OPEN_C) if self.faults.active("open_thermometer") else read_c

    def converter_thermometer_c(self, at_s: Array) -> Array:
        """As `thermometer_c`, of the thermometer at the converter."""
        return self._board_thermometer.readings_c(at_s, self.temperatures.course.board_thermometer_c(at_s))
