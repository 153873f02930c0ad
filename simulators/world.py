"""One physics for all simulated instruments: attitude, gravity, temperatures, power (equations 8).

Time here is *true* time: the host's clock, which the bench runs on, is itself an instrument with an error. The world
is computed lazily: every reading first computes it up to now. Before a stimulus changes, all integrating parts catch
up, so that no interval is integrated under the wrong stimulus.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from simulators.faults.instrument_faults import BROKEN_DRAWS
from simulators.physics.attitude import Mount
from simulators.physics.chamber_failures import Failure
from simulators.physics.motion import Axis
from simulators.physics.profiles import Slew
from simulators.physics.source_errors import Feed
from simulators.physics.table_kinematics import Level, TableKinematics
from simulators.physics.thermal import Thermal, UnitPhysics
from simulators.units.accelerometer_unit import Input, SimulatedUnit
from simulators.units.gyro_file import GyroFile
from simulators.units.gyro_unit import SimulatedGyro
from simulators.units.imu import SimulatedImu
from simulators.units.settings import PlaceSettings, WorldSettings
from simulators.units.unit_file import stream

Array = NDArray[np.float64]

STRAIGHT_S = 10.0  # time for which temperatures are taken as straight lines


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
                settings.table.loop, settings.table.ripple, settings.table.rate,
            )
            for (role, errors), path in zip(settings.axes.items(), _streams(settings.axes), strict=True)
        }  # fmt: skip
        level = Level(settings.level_deg, settings.level_drift_deg, settings.run_s)
        self.kinematics = TableKinematics(
            self.fixture, self.axes, level=level, table=settings.table,
            gravity_mps2=settings.gravity_mps2, latitude_deg=settings.latitude_deg,
        )  # fmt: skip
        names = sorted(settings.places)
        physics = tuple(self._physics(settings.places[name]) for name in names)
        imus = sorted(settings.imus)
        for name in imus:
            physics += SimulatedImu.physics(settings.imus[name].unit, settings.thermometer_lag_s)
        phase = float(stream(settings.seed, "chamber", "limit cycle").uniform(0, 2 * np.pi))
        self.thermal = Thermal(settings.chamber, physics, phase)
        self._integrators: list[Callable[[], None]] = []
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
        """True seconds since the start of the world."""
        return self.true_time(self._host_s())

    def true_time(self, host_s: float) -> float:
        """True time at which the host's clock shows `host_s`."""
        return (host_s - self._origin_s) * (1 + self.settings.host_clock)

    def host_time(self, true_s: Array) -> Array:
        """Host clock at true times."""
        return self._origin_s + true_s / (1 + self.settings.host_clock)

    def look(self) -> float:
        """Compute the temperatures up to now, at least every STRAIGHT_S; return now."""
        now = self.now()
        passed_s = now - self.thermal.now_s
        pieces = max(1, math.ceil(passed_s / STRAIGHT_S))
        for left in reversed(range(pieces)):
            self._follow(now - left * passed_s / pieces)
        return now

    def _follow(self, at_s: float) -> None:
        self.thermal.advance(at_s)
        for unit in self.units.values():
            unit.temperatures.follow(at_s, unit.powered_at_s is not None)
        for gyro in self.gyros.values():
            gyro.temperatures.follow(at_s)
        for imu in self.imus.values():
            imu.temperatures.follow(at_s, imu.powered_at_s is not None)

    def moves_until_s(self, from_s: float, now_s: float) -> float:
        """Time at which all axes moving at `from_s` are at rest; now if one does not stop."""
        return min(now_s, max((from_s + axis.rests_in_s(from_s) for axis in self.axes.values()), default=from_s))

    def integrate_with(self, catch_up: Callable[[], None]) -> None:
        """Register a function that is called before a stimulus changes."""
        self._integrators.append(catch_up)

    def before_change(self) -> float:
        """Call before any stimulus changes; returns now."""
        now = self.look()
        for catch_up in self._integrators:
            catch_up()
        return now

    # Stimuli changed by instruments

    def axis_of(self, role: str | None) -> Axis:
        """Axis driven by a controller; without a role that of the head."""
        return self.axis if role is None else self.axes[role]

    def move(
        self, target_deg: float, rate_dps: float, acceleration_dps2: float | None = None, role: str | None = None
    ) -> None:
        """Begin a move of an axis to `target_deg`, with the acceleration of the settings unless one is given."""
        self.axis_of(role).start(self.before_change(), target_deg, rate_dps, acceleration_dps2)

    def place(self, angle_deg: float, *, from_above: bool, role: str | None = None) -> None:
        """Set an axis by hand to an angle, approached from above or below."""
        self.axis_of(role).place(self.before_change(), angle_deg, from_above=from_above)

    def turn(self, rate_dps: float, acceleration_dps2: float, role: str | None = None) -> None:
        """Change the rate of an axis."""
        self.axis_of(role).turn(self.before_change(), rate_dps, acceleration_dps2)

    def swing(self, amplitude_deg: Slew, frequency_hz: Slew, phase_deg: float, role: str | None = None) -> None:
        """Begin an oscillation of an axis about its present angle."""
        self.axis_of(role).swing(self.before_change(), amplitude_deg, frequency_hz, phase_deg)

    def change_swing(
        self, amplitude_deg: float, frequency_hz: float, speeds: tuple[float, float], role: str | None = None
    ) -> None:
        """Change amplitude and frequency of the present oscillation of an axis at the `speeds`, in °/s and Hz/s."""
        self.axis_of(role).change_swing(self.before_change(), amplitude_deg, frequency_hz, speeds)

    def stop(self, role: str | None = None) -> None:
        """Stop an axis."""
        self.axis_of(role).stop(self.before_change())

    def ramp(self, target_c: float, rate_c_per_s: float) -> None:
        """Begin a ramp of the chamber's active set point to `target_c`."""
        self.before_change()
        self.thermal.ramp(target_c, rate_c_per_s)

    def door(self, *, is_open: bool) -> None:
        """Open or close the chamber's door."""
        self.before_change()
        self.thermal.door(self.settings.ambient_c if is_open else None)

    def chamber_fails(self, failure: Failure | None) -> None:
        """Break a part of the chamber; None repairs it."""
        self.before_change()
        self.thermal.fail(failure, self.settings.ambient_c)

    def power(self, supply: str, on: bool) -> None:
        """Switch a supply's output, and with it the units on it."""
        now = self.before_change()
        for index, unit in enumerate(self.counted.values()):
            if unit.settings.supply == supply and on != (unit.powered_at_s is not None):
                unit.power(now if on else None)
                self.thermal.power(index, on)
        for imu in self.imus.values():
            if imu.settings.supply == supply:
                imu.power(now, on)

    def fix_units(self, mount: Mount) -> None:
        """Mount all units by hand, in another orientation or the same; mounting angles scatter each time."""
        now = self.before_change()
        self.mount = mount
        for unit in self.units.values():
            unit.fixed_anew(now)

    def connect(self, fed_by: Input, channel: str = "") -> None:
        """Connect the accelerometers, or the cables of the sources instead, to the converters.

        A converter has one input. The cable of a disconnected source ends in a load. Of an inertial unit, all
        accelerometers are connected, or none and the cable is plugged into the converter of one `channel`.
        """
        self.before_change()
        for unit in self.units.values():
            unit.input = fed_by
        for imu in self.imus.values():
            imu.input, imu.fed_channel = fed_by, channel

    def source_a(self, source: str, at_s: Array) -> Array:
        """Current of a source's cable at true times."""
        feed = self.sources.get(source)
        return np.zeros_like(at_s) if feed is None else feed.current_a(at_s)

    def load_a(self, supply: str) -> float:
        """Current of the units on a supply while its output is on."""
        drawn_a = math.fsum(
            unit.truth.supply_a * (BROKEN_DRAWS if unit.faults.active("current") else 1.0)
            for unit in self.counted.values()
            if unit.settings.supply == supply
        )
        return drawn_a + math.fsum(imu.drawn_a for imu in self.imus.values() if imu.settings.supply == supply)


def _streams(roles: Iterable[str]) -> Iterator[tuple[str, ...]]:
    """Names of the random streams of each axis: the head has its own, further axes are named by role."""
    for number, role in enumerate(roles):
        yield ("head",) if number == 0 else ("head", role)
