"""An inertial unit in its place: counts or codes of its six channels, and readings of its thermometers.

Its three accelerometers are computed together, and so are its gyros: their constants are columns, (3, 1), and stimuli
have a row for each axis. The accelerometers are assumed at the intersection of the table's axes, unless the unit is on
an arm (`imu_on_table`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from simulators.faults.instrument_faults import BROKEN_DRAWS, OPEN_C, FaultPlan
from simulators.physics.attitude import to_unit
from simulators.physics.noise import mean_noise
from simulators.physics.table_kinematics import Stands, waves_of
from simulators.physics.thermal import UnitPhysics
from simulators.units.accelerometer import Hysteresis, Sent, noise_of
from simulators.units.accelerometer_unit import Input
from simulators.units.course import straight
from simulators.units.gyro import noise_of_gyro
from simulators.units.history import History
from simulators.units.imu_drawn import draw_imu, stacked
from simulators.units.imu_file import NAMES, ImuFile
from simulators.units.imu_on_table import SensorsOnTable, is_on_table
from simulators.units.imu_temperatures import CHANNELS, CIRCUIT, ImuTemperatures, TemperatureCircuit
from simulators.units.sensor_temperatures import SensorTemperatures
from simulators.units.settings import WorldSettings
from simulators.units.surroundings import Surroundings
from simulators.units.unit_file import stream
from simulators.units.unit_temperatures import Board, Thermometer, UnitTemperatures, followed_c

Array = NDArray[np.float64]
Components = tuple[Array, Array, Array]
"""Components of a vector for each axis: along itself, and along the two after it, (3, n) each."""


class ImuState(NamedTuple):
    """State of a unit at true times (k,): contributions of hysteresis, drift and warm-up to the biases of x, y and z.

    Also those of the rate of temperature to the accelerometers, and the temperatures of its sensors, by CHANNELS.
    """

    true_s: Array
    accelerometers_g: Array
    gyros_dps: Array
    moving_g: Array
    sensors_c: Array

    @classmethod
    def of(cls, rows: Array) -> ImuState:
        """States in rows of a history."""
        true_s, *others = np.split(rows.T, np.cumsum([1, *(len(NAMES),) * 3]))
        return cls(true_s[0], *others)


class SimulatedImu:
    """One inertial unit; `sensors` are the indices of its accelerometers and gyros in the world's temperatures."""

    def __init__(self, place: str, sensors: tuple[int, int], settings: WorldSettings, world: Surroundings) -> None:
        self.place, self.settings, self._world = place, settings.imus[place], world
        self.truth = draw_imu(self.settings.unit, settings.seed, place)
        self._sensors = sensors
        self._accelerometers, self._gyros = stacked(self.truth.accelerometers), stacked(self.truth.gyros)
        named = list(zip(NAMES, self.truth.accelerometers, self.truth.gyros, strict=True))
        self._noise = [noise_of(truth, settings.seed, f"{place}/acc_{axis}") for axis, truth, _ in named]
        self._noise += [noise_of_gyro(truth, settings.seed, place, f"gyro_{axis}") for axis, _, truth in named]
        self._gyro_drift = stacked(self.truth.gyro_drifts)
        self._gyros_send = stacked(self.truth.gyros_send) if self.truth.gyros_send else None
        on_table = is_on_table(self.truth, self.settings)
        self._on_table = SensorsOnTable(self.truth, self.settings, world) if on_table else None
        self._hysteresis = [Hysteresis(truth, settings.chamber.start_c) for _, truth, _ in named]
        start_c, unit = settings.chamber.start_c, self.settings.unit.accelerometer(NAMES[0])
        accelerometers = UnitTemperatures(world.thermal, sensors[0], unit, start_c, settings.thermometer_lag_s)
        gyros = SensorTemperatures(world.thermal, sensors[1], start_c)
        self.temperatures = ImuTemperatures(accelerometers, gyros, self.settings.unit.thermal, settings.ambient_c)
        self.board, self._board_course = Board(accelerometers), accelerometers.course
        named_errors = {**self.settings.thermometers, "converter": self.settings.converter_thermometer}
        self._thermometers = {
            sensor: Thermometer(
                errors, settings.thermometer_noise_c,
                stream(settings.seed, "noise", place, sensor, "thermometer"), settings.run_s,
            )
            for sensor, errors in named_errors.items()
        }  # fmt: skip
        self._board_thermometer = self._thermometers.pop("converter")
        noise = stream(settings.seed, "noise", place, CIRCUIT)
        circuit = self.truth.circuit
        self._circuit = None if circuit is None else TemperatureCircuit(circuit, noise)
        self._hysteresis_g = np.zeros((len(NAMES), 1))  # at the end of the last block
        self.input: Input = "accelerometer"
        self.fed_channel = ""  # of CHANNELS, into whose converter the cable of the source is plugged
        self._cached_for: tuple[float, float, int] = (-1.0, -1.0, 0)
        self._cached: Array = np.empty((len(CHANNELS), 0))
        self._still_key: Any = None  # arguments of the next two
        self._at_rest: tuple[Components, Components] | None = None
        self._turning: tuple[Array, Array, Array] | None = None  # up, earth rate, axis of rotation
        self.faults = FaultPlan(now_s=world.now)
        self.powered_at_s: float | None = None
        self.history = History(1 + 3 * len(NAMES) + len(CHANNELS))  # an ImuState in each row

    @staticmethod
    def physics(unit: ImuFile, thermometer_s: float) -> tuple[UnitPhysics, UnitPhysics]:
        """Thermal response of its accelerometers and gyros to the air: one case for both."""
        model, converter = unit.thermal, unit.accelerometers.x.converter
        board_s = converter.time_constant if converter.in_chamber else None
        return (
            UnitPhysics(
                model.case_time_constant, model.accelerometer_time_constant, model.self_heating, thermometer_s, board_s
            ),
            UnitPhysics(model.case_time_constant, model.gyro_time_constant, model.self_heating, thermometer_s),
        )

    @property
    def channels(self) -> Mapping[str, ImuChannel]:
        """Channels of a counter or telemetry, by name."""
        return {channel: ImuChannel(self, CHANNELS.index(name)) for name, channel in self.settings.channels.items()}

    def power(self, now_s: float, on: bool) -> None:
        """Switch its supply on or off."""
        if on != (self.powered_at_s is not None):
            self.powered_at_s = now_s if on else None
            for index in self._sensors:
                self._world.thermal.power(index, on)

    @property
    def swings(self) -> bool:
        """True if the inputs of its sensors may reverse between two latches."""
        return self._on_table is not None

    @property
    def drawn_a(self) -> float:
        """Supply current."""
        return self.truth.supply_a * (BROKEN_DRAWS if self.faults.active("current") else 1.0)

    def charge_pulses(self, edges_s: Array) -> Array:
        """Charge of each of CHANNELS in each interval between the consecutive times `edges_s`, in pulses, (6, n).

        The world is computed up to the last edge, or less than a latch beyond it. Repeated calls for the same times
        return the same.
        """
        return self._once(edges_s, self._pulses)

    def mean_codes(self, edges_s: Array) -> Array:
        """Mean output of each of CHANNELS in each interval, as in `charge_pulses`, in codes before rounding, (6, n)."""
        return self._once(edges_s, self._codes)

    def _once(self, edges_s: Array, compute: Callable[[Array], Array]) -> Array:
        """Cached result for repeated calls with the same times; a unit gives pulses or sends codes, never both."""
        edges = (float(edges_s[0]), float(edges_s[-1]), len(edges_s))
        if edges != self._cached_for:
            self._cached_for, self._cached = edges, compute(edges_s)
        return self._cached

    def thermometer_c(self, sensor: str, at_s: Array) -> Array:
        """Readings of one of its thermometers at times since the last call, with its errors and noise.

        `sensor` is a triad of SENSORS, one of CHANNELS, or CIRCUIT, whose readings are frequencies in Hz.
        """
        at_unit_c = self.temperatures.thermometer_c(sensor, at_s)
        if sensor == CIRCUIT and self._circuit is not None:
            return self._circuit.readings_hz(at_s, at_unit_c)
        if self.faults.active("open_thermometer"):
            return np.full(len(at_s), OPEN_C)
        true_c = followed_c(self.faults, at_unit_c, self._world.settings.ambient_c)
        return self._thermometers[sensor].readings_c(at_s, true_c)

    def converter_thermometer_c(self, at_s: Array) -> Array:
        """As `thermometer_c`, of the thermometer on the board of its converters."""
        return self._board_thermometer.readings_c(at_s, self._board_course.board_thermometer_c(at_s))

    def _pulses(self, edges_s: Array) -> Array:
        current_a, gyro_pps, board_c = self._sensed(edges_s)
        if current_a is None:
            return np.zeros((len(CHANNELS), len(edges_s) - 1))
        pulses = np.concatenate([self._accelerometers.rate_pps(current_a, board_c), gyro_pps])
        pulses *= edges_s[1:] - edges_s[:-1]
        return pulses

    def _codes(self, edges_s: Array) -> Array:
        current_a, gyro_pps, board_c = self._sensed(edges_s)
        if current_a is None or self._gyros_send is None:
            return np.zeros((len(CHANNELS), len(edges_s) - 1))
        return np.concatenate([self._accelerometers.codes(current_a, board_c), self._gyros_send.codes(gyro_pps)])

    def _sensed(self, edges_s: Array) -> tuple[Array | None, Array, Array | None]:
        """Mean currents of the accelerometers and mean pulse rates of the gyros, (3, n); no current without power.

        Also the temperature of the converters; None outside the chamber.
        """
        middle, interval = (edges_s[1:] + edges_s[:-1]) / 2, edges_s[1:] - edges_s[:-1]
        corners_s = self.temperatures.corners_s(float(edges_s[0]), float(edges_s[-1]))
        slow, sensors_c = self._slow(corners_s)
        board_c = self.board.followed_c(corners_s, middle, np.zeros(1))  # drifts of the biases are in `history`
        if self.powered_at_s is None or self.faults.active("dead"):
            return None, np.empty(0), board_c
        if not self.temperatures.has_gradients:
            sensors_c = sensors_c[:: len(NAMES)]
        drifting, warm_c = np.split(straight(corners_s, np.concatenate([slow, sensors_c]), middle), [len(slow)])
        drifting += mean_noise(self._noise, interval)
        drifting_g, drifting_dps = drifting[: len(NAMES)], drifting[len(NAMES) :]
        accelerometer_c, gyro_c = np.split(warm_c, 2) if self.temperatures.has_gradients else (warm_c[0], warm_c[1])
        if self._on_table is not None:
            warm, biases = (accelerometer_c, gyro_c), (drifting_g, drifting_dps)
            current_a, gyro_pps = self._on_table.sensed(edges_s, warm, biases)
            return current_a, self._gyros.clipped_pps(gyro_pps), board_c
        force_g, rate_dps = self._stimulus(edges_s, middle)
        current_a = self._accelerometers.current_a(force_g, accelerometer_c, drifting_g)
        gyro_pps = self._gyros.output_pps(rate_dps, force_g, gyro_c, drifting_dps)
        if self.input == "source":
            current_a = self._from_source(middle)
        return current_a, self._gyros.clipped_pps(gyro_pps), board_c

    def _from_source(self, at_s: Array) -> Array:
        """Currents of the accelerometer channels (3, n) with the accelerometers disconnected: that of the source."""
        current_a = np.zeros((len(NAMES), len(at_s)))
        fed = CHANNELS.index(self.fed_channel) if self.fed_channel else len(NAMES)
        if fed < len(NAMES):
            current_a[fed] = self._world.source_a(self.settings.source, at_s)
        return current_a

    def _slow(self, corners_s: Array) -> tuple[Array, Array]:
        """What is slow, at times (k,): biases of CHANNELS without noise in g and °/s, and their temperatures, (6, k).

        Hysteresis follows from each of the times to the next, and the history goes on.
        """
        sensors_c = self.temperatures.sensors_c(corners_s)
        followed_g = [
            play.follow(course_c)
            for play, course_c in zip(self._hysteresis, sensors_c[: len(NAMES), 1:].tolist(), strict=True)
        ]
        hysteresis_g = np.concatenate([self._hysteresis_g, followed_g], axis=1)
        self._hysteresis_g = hysteresis_g[:, -1:]
        drift_g, drift_dps = self._drifts(corners_s)
        drift_g = drift_g + hysteresis_g
        moving_g = self._accelerometers.kd * self.temperatures.rates_c_per_s(corners_s)
        state = ImuState(corners_s, drift_g, drift_dps, moving_g, sensors_c)
        self.history.add(np.vstack(state)[:, 1:].T)
        return np.concatenate([drift_g + moving_g, drift_dps]), sensors_c

    def _drifts(self, true_s: Array) -> tuple[Array, Array]:
        """Drift and warm-up of the biases of its accelerometers (g) and its gyros (°/s) at times (k,): (3, k) each."""
        accelerometers, gyros = self._accelerometers, self._gyro_drift
        drift_g, drift_dps = accelerometers.drift_g_per_s * true_s, gyros.drift_dps2 * true_s
        if self.powered_at_s is not None:
            powered_s = true_s - self.powered_at_s
            drift_g = drift_g + accelerometers.warm_up_g * np.exp(-powered_s / accelerometers.warm_up_s)
            drift_dps = drift_dps + gyros.warm_up_dps * np.exp(-powered_s / gyros.warm_up_s)
        return drift_g, drift_dps

    def _stimulus(self, edges_s: Array, middle_s: Array) -> tuple[Components, Components]:
        """Specific force in g and rate in °/s at its sensors, (3, n) each, or (3, 1) at rest."""
        kinematics = self._world.kinematics
        still_deg = kinematics.stands(float(edges_s[0]))
        key = (still_deg, self._world.mount)
        if key != self._still_key:
            self._still_key, self._at_rest, self._turning = key, None, None
        if None not in still_deg:
            if self._at_rest is None:
                attitude = self._into_unit @ kinematics.attitude(middle_s[:1])[0]
                self._at_rest = _along(attitude[:, 2:]), _along(attitude @ kinematics.earth_dps[:, np.newaxis])
            return self._at_rest
        if kinematics.sweeps(still_deg):
            return self._while_one_turns(still_deg, edges_s, middle_s)
        attitude = kinematics.attitude(middle_s)
        by_earth_dps = (attitude.reshape(-1, 3) @ kinematics.earth_dps).reshape(-1, 3).T
        turning_dps = by_earth_dps + self._turning_dps(edges_s)
        return _along(self._into_unit @ attitude[:, :, 2].T), _along(self._into_unit @ turning_dps)

    @property
    def _into_unit(self) -> Array:
        return to_unit(self._world.mount, self.settings.mount_angle_deg)

    def _while_one_turns(self, still_deg: Stands, edges_s: Array, middle_s: Array) -> tuple[Components, Components]:
        """The same while one axis turns, about a direction that is fixed in the unit."""
        world = self._world
        if self._turning is None:
            angles_deg = [np.full(1, at or 0.0) for at in still_deg]
            about = world.fixture.rate(angles_deg, [np.full(1, float(at is None)) for at in still_deg]).T
            sweep = self._into_unit @ world.kinematics.sweep(still_deg, float(edges_s[0]))
            self._turning = sweep[:, :, 2].T, (sweep @ world.kinematics.earth_dps).T, self._into_unit @ about
        up, earth_dps, about = self._turning
        axis = list(world.axes.values())[still_deg.index(None)]
        angle_deg = axis.true_deg(np.concatenate([edges_s, middle_s]))
        at_edges_deg, waves = angle_deg[: len(edges_s)], waves_of(angle_deg[len(edges_s) :])
        rate_dps = (at_edges_deg[1:] - at_edges_deg[:-1]) / (edges_s[1:] - edges_s[:-1])
        return _along(up @ waves), _along(earth_dps @ waves + about * rate_dps)

    def _turning_dps(self, edges_s: Array) -> Array:
        """Angular rate of the fixture in each interval, in the fixture's frame, (3, n)."""
        interval_s = edges_s[1:] - edges_s[:-1]
        angles_deg = [axis.true_deg(edges_s) for axis in self._world.axes.values()]
        rates_dps = [(angle_deg[1:] - angle_deg[:-1]) / interval_s for angle_deg in angles_deg]
        middle_deg = [(angle_deg[1:] + angle_deg[:-1]) / 2 for angle_deg in angles_deg]
        return self._world.fixture.rate(middle_deg, rates_dps).T


@dataclass(frozen=True, slots=True)
class ImuChannel:
    """One channel of a unit, as counted by a counter, or as sent by the unit."""

    imu: SimulatedImu
    row: int

    @property
    def faults(self) -> FaultPlan:
        """Faults of the unit."""
        return self.imu.faults

    @property
    def swings(self) -> bool:
        """True on an arm of a rate table; else between two latches the unit is at rest or turns uniformly."""
        return self.imu.swings

    def charge_pulses(self, edges_s: Array) -> Array:
        """Charge in each interval between the consecutive times `edges_s`, in pulses."""
        return np.asarray(self.imu.charge_pulses(edges_s)[self.row])

    def mean_codes(self, edges_s: Array) -> Array:
        """Mean output in each interval, in codes before rounding."""
        return np.asarray(self.imu.mean_codes(edges_s)[self.row])

    @property
    def place(self) -> str:
        """Place of the unit."""
        return self.imu.place

    @property
    def powered_at_s(self) -> float | None:
        """Time of power-on; None without power."""
        return self.imu.powered_at_s

    @property
    def sent(self) -> Sent:
        """Its conversion to codes."""
        truth, axis = self.imu.truth, self.row % len(NAMES)
        of_gyro = self.row >= len(NAMES)
        codes = truth.gyros_send[axis] if of_gyro else truth.accelerometers[axis]
        return Sent(truth.clock, codes.zero_code, codes.noise_code)


def _along(vectors: Array) -> Components:
    """Components along x, y and z (3, n) for each axis, as Seen."""
    return vectors, vectors[[1, 2, 0]], vectors[[2, 0, 1]]
