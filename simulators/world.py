"""One physics for all simulated instruments: attitude, gravity, temperatures, power (methods.md section 8).

Time here is *true* time: the host's clock, which the bench runs on, is itself an instrument with an error. The world
is worked out lazily. Whoever looks asks for it "up to now"; whoever changes a stimulus first lets everybody who
integrates catch up, so that no part of the time is counted under the wrong stimulus.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from simulators.attitude import Fixture, Mount, Vector, to_unit
from simulators.carried import NOWHERE, Carried, TableErrors
from simulators.corrections import Table
from simulators.current_source import Feed
from simulators.dynamics import POINTS, Follower, look_at_s
from simulators.faults import BROKEN_DRAWS, OPEN_C, FaultPlan
from simulators.gyro_unit import GyroFile, SimulatedGyro
from simulators.imu import ImuPlace, SimulatedImu
from simulators.motion import Axis, AxisErrors
from simulators.profiles import Slew
from simulators.thermal import ChamberPhysics, Thermal, UnitPhysics
from simulators.unit_file import UnitFile, stream
from simulators.uut import Hysteresis, Noise, UnitTruth, draw_unit
from simulators.warmth import Board, Thermometer, Warmth

Array = NDArray[np.float64]
Input = Literal["accelerometer", "source"]  # what a converter is connected to
LOOK_S = 0.02  # how finely a mean current follows the head


@dataclass(frozen=True, slots=True)
class PlaceSettings:
    """One unit in its place. `thermometer_offset_c` and `thermometer_gain` are the errors drawn for its reading.

    They come on top of those that its `thermometer_table` corrects, °C to be added at readings in °C.
    Its output are pulses on a `channel`, or the volts across `load_ohm`. `faults` are kinds, each with the time from
    which it is there. The errors of `converter_` are for the thermometer at its converter; `source` is the device that
    may feed that. `arm_m` is where it truly is from where the axes of the table meet, in the fixture's frame.
    """

    unit: UnitFile | GyroFile
    channel: str
    supply: str
    mount_angle_deg: float = 0.0
    thermometer_offset_c: float = 0.0
    thermometer_gain: float = 0.0
    thermometer_table: Table = ((), ())
    faults: Mapping[str, float] = field(default_factory=dict)
    load_ohm: float | None = None
    converter_offset_c: float = 0.0
    converter_gain: float = 0.0
    converter_table: Table = ((), ())
    source: str = ""
    arm_m: Vector = NOWHERE


@dataclass(frozen=True, slots=True)
class WorldSettings:
    """The laboratory of one run: its seed, its own errors as drawn, and the units by place.

    `axes` are those of the table by the role of what drives them, outer first, as the fixture has them. `level_deg` is
    how far its base is tilted, `mount` how the units are fixed in the beginning. `fixture` is as it was meant, `built`
    as it is; without it they are the same.
    """

    seed: int
    gravity_mps2: float
    host_clock: float = 0.0  # relative error of the host's clock against the true second
    device_clock: float = 0.0  # relative error of the counter's time base
    encoder_skew_s: float = 0.0  # by which the counter latches an encoder later than the pulses
    axes: Mapping[str, AxisErrors] = field(default_factory=lambda: {"head": AxisErrors()})
    axis_acceleration_dps2: float = 40.0
    level_deg: float = 0.0
    latitude_deg: float = 0.0
    table: TableErrors = field(default_factory=TableErrors)
    mount: Mount = field(default_factory=Mount)
    remount_deg: float = 0.0  # standard deviation of how a unit lies each time that it is fixed by hand
    fixture: Fixture = field(default_factory=Fixture)
    chamber: ChamberPhysics = field(default_factory=ChamberPhysics)
    thermometer_lag_s: float = 20.0
    thermometer_noise_c: float = 0.005
    places: Mapping[str, PlaceSettings] = field(default_factory=dict)
    imus: Mapping[str, ImuPlace] = field(default_factory=dict)
    built: Fixture | None = None


class UnitState(NamedTuple):
    """A unit at a true time: what hysteresis, drift and warm-up add to its bias, and what the rate of temperature adds.

    Beside them the temperatures of its sensor and of an ideal thermometer at it.
    """

    true_s: float
    drifted_g: float
    moving_g: float
    sensor_c: float
    thermometer_c: float


class SimulatedUnit:
    """One unit in its place: what its converter counts, and what the thermometer at it says."""

    def __init__(self, place: str, file: UnitFile, index: int, settings: WorldSettings, world: World) -> None:
        self.place = place
        self.settings = settings.places[place]
        self.truth: UnitTruth = draw_unit(file, settings.seed, place)
        self._follower = Follower(self.truth.dynamics) if self.truth.dynamics is not None else None
        self.faults = FaultPlan(self.settings.faults, world.now)
        self._index, self._world = index, world
        self.seats_deg: list[tuple[float, float]] = []  # true time of each fixing by hand, and how askew it is since
        self._turn_on = stream(settings.seed, "uut", place, "accelerometer", "turn_on")
        self._turned_on_g = 0.0
        self._noise = Noise(self.truth, settings.seed, place)
        self._hysteresis = Hysteresis(self.truth, settings.chamber.start_c)
        start_c = settings.chamber.start_c
        self.warmth = Warmth(world.thermal, index, file, start_c, settings.thermometer_lag_s)
        self._thermometer, self._board_thermometer = self._thermometers(settings)
        self.board = Board(self.warmth, start_c)
        self._last_c = start_c
        self.powered_at_s: float | None = None
        self.history: list[UnitState] = []
        self.input: Input = "accelerometer"

    def _thermometers(self, settings: WorldSettings) -> tuple[Thermometer, Thermometer]:
        """At the unit and at its converter."""
        own, start_c, noise_c = self.settings, settings.chamber.start_c, settings.thermometer_noise_c

        def noise(name: str) -> np.random.Generator:
            return stream(settings.seed, "noise", self.place, name)

        return (
            Thermometer(
                start_c, own.thermometer_offset_c, own.thermometer_gain, noise_c, noise("thermometer"),
                own.thermometer_table,
            ),
            Thermometer(
                start_c if self.warmth.board_in_chamber else self.warmth.board_c,
                own.converter_offset_c, own.converter_gain, noise_c, noise("converter thermometer"),
                own.converter_table,
            ),
        )  # fmt: skip

    def power(self, since_s: float | None) -> None:
        """It has power since a time, or none; each power-on steps the bias by a draw of its own."""
        self.powered_at_s = since_s
        if since_s is not None and self.truth.turn_on_g:
            self._turned_on_g = self.truth.turn_on_g * float(self._turn_on.standard_normal())

    def fixed_anew(self, at_s: float) -> None:
        """Somebody has fixed it by hand: how askew it lies now is drawn anew."""
        if sd_deg := self._world.settings.remount_deg:
            draw = stream(self._world.settings.seed, "remount", self.place, str(len(self.seats_deg)))
            self.seats_deg.append((at_s, sd_deg * float(draw.standard_normal())))

    @property
    def swings(self) -> bool:
        """Whether what it senses may turn round between two latches."""
        return self._follower is not None

    def charge_pulses(self, edges_s: Array) -> Array:
        """Pulses that the converter is owed in each interval between the consecutive times `edges_s`.

        The world has been worked out up to the last edge, or by less than a latch beyond it.
        """
        middle, interval = (edges_s[1:] + edges_s[:-1]) / 2, edges_s[1:] - edges_s[:-1]
        now_c = self.warmth.sensor_c
        span = edges_s[-1] - edges_s[0]
        temperature = self._last_c + (middle - edges_s[0]) * ((now_c - self._last_c) / span)
        hysteresis_g = self._hysteresis.bias_g(now_c)
        self.history.append(self._state(float(edges_s[-1]), hysteresis_g))
        self._last_c = now_c
        board_c = self.board.followed_c(edges_s, middle, self.history[-1].drifted_g)
        if self.powered_at_s is None:
            return np.zeros_like(middle)
        noise_g = self._noise.mean_g(interval)
        if self._follower is None:
            current = self._current_a(middle, temperature, hysteresis_g, noise_g)
        else:
            look_s = look_at_s(edges_s, self.truth.delay_s)
            temperature, noise_g = (np.repeat(values, len(POINTS)) for values in (temperature, noise_g))
            looked_at = self._current_a(look_s.ravel(), temperature, hysteresis_g, noise_g)
            current = self._follower.mean(looked_at.reshape(look_s.shape), interval)
        if self.input == "source":
            current = self._world.source_a(self.settings.source, middle)
        if self.faults.active("dead"):
            return np.zeros_like(middle)
        return self.truth.rate_pps(current, board_c) * interval

    def mean_current_a(self, begin_s: float, end_s: float, noise: Noise) -> float:
        """What flows from the accelerometer, as a mean from `begin_s` to `end_s`; 0 without power.

        The world has been worked out up to the end. Whoever looks has a `noise` of his own, so that the noise that
        others find does not depend on how often he does.
        """
        hysteresis_g = self._hysteresis.bias_g(self.warmth.sensor_c)
        if not self.settings.channel:  # nobody else keeps its history
            self.history.append(self._state(self._world.thermal.now_s, hysteresis_g))
        if self.powered_at_s is None:
            return 0.0
        edges_s = np.linspace(begin_s, end_s, 1 + math.ceil((end_s - begin_s) / LOOK_S))
        middle, interval = (edges_s[1:] + edges_s[:-1]) / 2, edges_s[1:] - edges_s[:-1]
        since_s = middle - self._world.thermal.now_s
        temperature = self.warmth.sensor_c + since_s * self.warmth.sensor_rate_c_per_s
        return float(self._current_a(middle, temperature, hysteresis_g, noise.mean_g(interval)).mean())

    def _state(self, true_s: float, hysteresis_g: float) -> UnitState:
        drifted_g = hysteresis_g + float(self._slow_bias_g(np.array([true_s]))[0])
        return UnitState(true_s, drifted_g, self._moving_g(), self.warmth.sensor_c, self.warmth.thermometer_c)

    def _moving_g(self) -> float:
        """What the rate of temperature adds to the bias."""
        return self.truth.kd * self.warmth.sensor_rate_c_per_s

    def _current_a(self, at_s: Array, temperature_c: Array, hysteresis_g: float, noise_g: Array) -> Array:
        drifting = self._slow_bias_g(at_s) + (hysteresis_g + self._moving_g())
        return self.truth.current_a(self.force_g(at_s), temperature_c, drifting + noise_g)

    def _slow_bias_g(self, at_s: Array) -> Array:
        """Drift, the step of the last power-on and, while powered, warm-up at the times `at_s`."""
        drift = self.truth.drift_g_per_s * at_s + self._turned_on_g
        if self.powered_at_s is None:
            return drift
        return drift + self.truth.warm_up_g * np.exp((self.powered_at_s - at_s) / self.truth.warm_up_s)

    def force_g(self, at_s: Array) -> tuple[Array, Array, Array]:
        """Specific force along the input, pendulous and output axes, in local g."""
        seat_deg = self.seats_deg[-1][1] if self.seats_deg else 0.0
        force = self._world.carried.force_g(at_s, self.settings.arm_m)
        x, y, z = to_unit(self._world.mount, self.settings.mount_angle_deg + seat_deg) @ force
        return x, z, y

    def thermometer_c(self, at_s: Array) -> Array:
        """Readings of the thermometer at the unit at times since the last call, with its errors and noise."""
        read_c = self._thermometer.readings_c(at_s, self._world.thermal.now_s, self.warmth.thermometer_c)
        return np.full_like(read_c, OPEN_C) if self.faults.active("open_thermometer") else read_c

    def converter_thermometer_c(self, at_s: Array) -> Array:
        """As `thermometer_c`, of the thermometer at the converter."""
        return self._board_thermometer.readings_c(at_s, self._world.thermal.now_s, self.warmth.board_thermometer_c)


class World:
    """The laboratory. `host_s` gives the host's clock; `now` is true time, which starts with it at 0.

    Concurrency: one event loop; nothing here waits.
    """

    def __init__(self, settings: WorldSettings, host_s: Callable[[], float]) -> None:
        self.settings = settings
        self._host_s, self._origin_s = host_s, host_s()
        self.mount = settings.mount
        self.fixture = settings.built or settings.fixture
        self.axes = {
            role: Axis(
                errors, settings.axis_acceleration_dps2, stream(settings.seed, *path, "repeatability"),
                settings.table.loop, settings.table.ripple,
            )
            for (role, errors), path in zip(settings.axes.items(), _streams(settings.axes), strict=True)
        }  # fmt: skip
        self.carried = Carried(
            self.fixture, self.axes, level_deg=settings.level_deg, table=settings.table,
            gravity_mps2=settings.gravity_mps2, latitude_deg=settings.latitude_deg,
        )  # fmt: skip
        names = sorted(settings.places)
        physics = tuple(self._physics(settings.places[name]) for name in names)
        imus = sorted(settings.imus)
        for name in imus:
            physics += SimulatedImu.physics(settings.imus[name].unit, settings.thermometer_lag_s)
        phase = float(stream(settings.seed, "chamber", "limit cycle").uniform(0, 2 * np.pi))
        self.thermal = Thermal(settings.chamber, physics, phase)
        self.units: dict[str, SimulatedUnit] = {}
        self.gyros: dict[str, SimulatedGyro] = {}
        for index, name in enumerate(names):
            match settings.places[name].unit:
                case GyroFile() as file:
                    self.gyros[name] = SimulatedGyro(name, file, index, settings, self)
                case file:
                    self.units[name] = SimulatedUnit(name, file, index, settings, self)
        self.imus = {
            name: SimulatedImu(name, (first, first + 1), settings, self)
            for first, name in zip(range(len(names), len(physics), 2), imus, strict=True)
        }
        self.counted: dict[str, SimulatedUnit | SimulatedGyro] = dict(
            sorted([*self.units.items(), *self.gyros.items()])
        )
        self.sources: dict[str, Feed] = {}
        self._integrators: list[Callable[[], None]] = []

    def _physics(self, place: PlaceSettings) -> UnitPhysics:
        model = place.unit.thermal
        converter = None if isinstance(place.unit, GyroFile) else place.unit.converter
        board_s = converter.time_constant if converter is not None and converter.in_chamber else None
        return UnitPhysics(
            model.case_time_constant, model.sensor_time_constant, model.self_heating, self.settings.thermometer_lag_s,
            board_s,
        )  # fmt: skip

    @property
    def axis(self) -> Axis:
        """The axis of the head, the outermost of a table with several."""
        return next(iter(self.axes.values()))

    def now(self) -> float:
        """True seconds since the world began."""
        return self.true_time(self._host_s())

    def true_time(self, host_s: float) -> float:
        """The true time at which the host's clock shows `host_s`."""
        return (host_s - self._origin_s) * (1 + self.settings.host_clock)

    def host_time(self, true_s: Array) -> Array:
        """What the host's clock shows at true times."""
        return self._origin_s + true_s / (1 + self.settings.host_clock)

    def look(self) -> float:
        """Works the temperatures out up to now, and returns now."""
        now = self.now()
        self.thermal.advance(now)
        for unit in self.units.values():
            unit.warmth.follow(now, unit.powered_at_s is not None)
        return now

    def integrate_with(self, catch_up: Callable[[], None]) -> None:
        """Registers somebody who integrates over time and must be told before a stimulus changes."""
        self._integrators.append(catch_up)

    def before_change(self) -> float:
        """To be called before any stimulus changes; returns now."""
        now = self.look()
        for catch_up in self._integrators:
            catch_up()
        return now

    # What instruments do to the world

    def axis_of(self, role: str | None) -> Axis:
        """The axis that a controller drives; without a role that of the head."""
        return self.axis if role is None else self.axes[role]

    def move(
        self, target_deg: float, rate_dps: float, acceleration_dps2: float | None = None, role: str | None = None
    ) -> None:
        """An axis starts for `target_deg`, with the acceleration of the settings unless one is given."""
        self.axis_of(role).start(self.before_change(), target_deg, rate_dps, acceleration_dps2)

    def turn(self, rate_dps: float, acceleration_dps2: float, role: str | None = None) -> None:
        """An axis changes its rate."""
        self.axis_of(role).turn(self.before_change(), rate_dps, acceleration_dps2)

    def swing(self, amplitude_deg: Slew, frequency_hz: Slew, phase_deg: float, role: str | None = None) -> None:
        """An axis begins to swing about where it is."""
        self.axis_of(role).swing(self.before_change(), amplitude_deg, frequency_hz, phase_deg)

    def stop(self, role: str | None = None) -> None:
        """An axis stands still."""
        self.axis_of(role).stop(self.before_change())

    def ramp(self, target_c: float, rate_c_per_s: float) -> None:
        """The chamber's set point in force starts for `target_c`."""
        self.before_change()
        self.thermal.ramp(target_c, rate_c_per_s)

    def power(self, supply: str, on: bool) -> None:
        """A supply's output goes on or off, and with it the units on it."""
        now = self.before_change()
        for index, unit in enumerate(self.counted.values()):
            if unit.settings.supply == supply and on != (unit.powered_at_s is not None):
                unit.power(now if on else None)
                self.thermal.power(index, on)
        for imu in self.imus.values():
            if imu.settings.supply == supply:
                imu.power(now, on)

    def fix_units(self, mount: Mount) -> None:
        """Somebody fixes all units, in another way or the same; each lies a little otherwise every time."""
        now = self.before_change()
        self.mount = mount
        for unit in self.units.values():
            unit.fixed_anew(now)

    def connect(self, fed_by: Input) -> None:
        """Somebody plugs the accelerometers, or the cables of the sources in their place, into the converters.

        A converter has one input. The cable of a source that is not in it ends in a load, where its current does not
        matter.
        """
        self.before_change()
        for unit in self.units.values():
            unit.input = fed_by

    def source_a(self, source: str, at_s: Array) -> Array:
        """What comes out of a source's cable at true times."""
        feed = self.sources.get(source)
        return np.zeros_like(at_s) if feed is None else feed.current_a(at_s)

    def load_a(self, supply: str) -> float:
        """What the units on a supply draw while its output is on."""
        drawn_a = sum(
            unit.truth.supply_a * (BROKEN_DRAWS if unit.faults.active("current") else 1.0)
            for unit in self.counted.values()
            if unit.settings.supply == supply
        )
        return drawn_a + sum(imu.drawn_a for imu in self.imus.values() if imu.settings.supply == supply)


def _streams(roles: Iterable[str]) -> Iterator[tuple[str, ...]]:
    """Under which names the random numbers of each axis are drawn: the head's its own, further axes by their roles."""
    for number, role in enumerate(roles):
        yield ("head",) if number == 0 else ("head", role)
