"""Errors of a simulated laboratory, drawn for one run within certificates and bench file.

Each error is drawn under its own name, so that an additional one leaves all others unchanged.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from dataclasses import replace

from bench.app.can_nodes import decoding_of, thermometers_at
from bench.config.fixture import Mount
from bench.config.models import BenchFile
from bench.config.places import PlaceEntry
from bench.config.simulation import SourceSimulation, TableSimulation
from bench.errors import InputError
from bench.reduce.certificates import HOUR_S, bench_record
from bench.reduce.corrections import Table as CorrectionTable
from bench.reduce.corrections import corrections_of
from drivers.certificates.corrections import ARCSEC_PER_DEG
from simulators.instruments.meters.meter_inputs import CurrentInSeries
from simulators.physics import attitude
from simulators.physics.attitude import SOUTH, Fixture, Vector, tilted
from simulators.physics.corrections import Table
from simulators.physics.motion import AxisErrors
from simulators.physics.servo import Loop, Ripple
from simulators.physics.source_errors import CurrentErrors
from simulators.physics.table_kinematics import NOWHERE, TableErrors
from simulators.physics.thermal import ChamberPhysics
from simulators.physics.voltmeter import VoltmeterSettings
from simulators.units.gyro_file import GyroFile
from simulators.units.imu_file import ImuFile
from simulators.units.imu_temperatures import CHANNELS, SENSORS
from simulators.units.settings import ImuPlace, PlaceSettings, WorldSettings
from simulators.units.unit_file import UnitFile, stream
from simulators.units.unit_temperatures import ThermometerErrors
from simulators.world import World

AnyUnitFile = UnitFile | GyroFile | ImuFile


def world_settings(bench: BenchFile, units: Mapping[str, AnyUnitFile], seed: int, run_s: float = 0.0) -> WorldSettings:
    """Return the settings of the laboratory for one run, with the truth of the unit in each place.

    Thermometers drift over the expected duration `run_s`; not at all if it is 0.
    """
    return _Draws(bench, seed).settings(units, run_s)


class _Draws:
    """Random draws for one bench file and one seed."""

    def __init__(self, bench: BenchFile, seed: int) -> None:
        self._bench, self._seed = bench, seed
        self._stated, self._corrections = bench_record(bench), corrections_of(bench)

    def settings(self, units: Mapping[str, AnyUnitFile], run_s: float) -> WorldSettings:
        """Return all settings of the simulated world."""
        bench, stated, simulation = self._bench, self._stated, self._bench.simulation
        fixture = Fixture(tuple(bench.axes.values()) or (SOUTH,), bench.fixture.x, bench.fixture.z)
        entries = [(name, units[name], entry) for name, entry in bench.places.items()]
        clock = next(iter(self._corrections.clocks.values()), 0.0)
        axes = enumerate(bench.axes or ["head"])
        return WorldSettings(
            seed=self._seed,
            gravity_mps2=stated.gravity_mps2 + self._draw(stated.gravity_u_mps2, "gravity"),
            host_clock=self._draw(
                stated.host_clock_u if bench.site.host_clock is not None else simulation.host_clock, "host clock"
            ),
            device_clock=self._draw(stated.time_base_u, "counter", "time base") - clock,
            encoder_skew_s=self._draw(stated.encoder_skew_u_s, "counter", "encoder skew"),
            axes={role: self._axis(role, () if number == 0 else (role,)) for number, role in axes},
            axis_acceleration_dps2=simulation.head.acceleration,
            mount=simulated_mount(bench.fixture.mount()),
            ambient_c=simulation.ambient,
            level_deg=stated.level_deg + self._draw(stated.level_u_deg, "level"),
            level_drift_deg=self._draw(stated.level_drift.u, "level", "drift"),
            latitude_deg=bench.site.latitude,
            table=TableErrors() if simulation.table is None else self._table(simulation.table),
            fixture=fixture,
            built=self._installed(fixture),
            chamber=_chamber(bench),
            remount_deg=simulation.remount / ARCSEC_PER_DEG,
            thermometer_lag_s=simulation.thermometer.lag,
            thermometer_noise_c=simulation.thermometer.noise,
            run_s=run_s,
            places={name: self._place(name, unit, at) for name, unit, at in entries if not isinstance(unit, ImuFile)},
            imus={name: self._imu(name, unit, at) for name, unit, at in entries if isinstance(unit, ImuFile)},
        )

    def _draw(self, sd: float, *path: str) -> float:
        return float(sd * stream(self._seed, "bench", *path).standard_normal())

    def _thermometer(self, reading: str) -> ThermometerErrors:
        """Return the errors of a thermometer within its certificate, in addition to the corrections there."""
        offset_u, gain_u = self._stated.thermometer_u(reading)
        return ThermometerErrors(
            offset_c=self._draw(offset_u, reading, "offset"),
            gain=self._draw(gain_u, reading, "gain"),
            drift_c=self._draw(self._stated.thermometer_drift(reading).u, reading, "drift"),
            table=columns(self._corrections.thermometers.get(reading)),
        )

    def _place(self, name: str, unit: UnitFile | GyroFile, entry: PlaceEntry) -> PlaceSettings:
        simulation = self._bench.simulation
        return PlaceSettings(
            unit=unit,
            channel=entry.channel,
            supply=entry.supply,
            mount_angle_deg=entry.mount_angle,
            clock_deg=entry.clock,
            thermometer=self._thermometer(entry.temperature),
            load_ohm=next((each.load for role, each in simulation.voltmeters.items() if role == entry.voltmeter), None),
            converter_thermometer=self._thermometer(entry.converter_temperature or ""),
            source=entry.source or "",
            arm_m=self._arm_m(name, entry),
            decoding=decoding_of(self._bench, entry.telemetry),
        )

    def _imu(self, name: str, unit: ImuFile, entry: PlaceEntry) -> ImuPlace:
        of_triads = (entry.temperature, entry.gyro_temperature or entry.temperature)
        read_at = dict(zip(SENSORS, of_triads, strict=True))
        read_at |= {at: reading for reading, at in thermometers_at(entry).items() if at in CHANNELS}
        channels = entry.channels.model_dump() if entry.channels is not None else {}
        decodings = {sensor: decoding_of(self._bench, channel) for sensor, channel in channels.items()}
        return ImuPlace(
            unit=unit,
            channels=channels,
            supply=entry.supply,
            mount_angle_deg=entry.mount_angle,
            thermometers={at: self._thermometer(reading) for at, reading in read_at.items()},
            decodings={name: each for name, each in decodings.items() if each is not None},
            converter_thermometer=self._thermometer(entry.converter_temperature or ""),
            source=entry.source or "",
            arm_m=self._arm_m(name, entry),
        )

    def _axis(self, role: str, path: tuple[str, ...]) -> AxisErrors:
        known = self._stated.axis(role)
        harmonics = enumerate(known.harmonics_u_deg, start=1)
        amplitudes = [
            [self._draw(u, "head", *path, str(order), shape) for shape in ("cosine", "sine")] for order, u in harmonics
        ]
        return AxisErrors(
            zero_deg=self._draw(known.zero_u_deg, "head", *path, "zero"),
            cosines=tuple(cosine for cosine, _ in amplitudes),
            sines=tuple(sine for _, sine in amplitudes),
            backlash_deg=self._backlash_deg(known.backlash_u_deg, path),
            repeatability_deg=known.repeatability_u_deg,
            table=columns(self._corrections.axes.get(role)),
        )

    def _backlash_deg(self, certified_u_deg: float | None, path: tuple[str, ...]) -> float:
        """Draw the backlash from the certificate, if it states one."""
        if certified_u_deg is None:
            return self._bench.simulation.head.backlash / ARCSEC_PER_DEG
        return self._draw(certified_u_deg, "head", *path, "backlash")

    def _installed(self, fixture: Fixture) -> Fixture:
        """Return a table with several axes as installed: rotated about the vertical, tilted, not quite square."""
        if len(fixture.axes) < 2:
            return fixture
        stated = self._stated
        east_deg, azimuth_deg = (
            self._draw(stated.level_u_deg, "level", "east"), self._draw(stated.azimuth_u_deg, "azimuth"),
        )  # fmt: skip
        apart = [
            (self._draw(stated.orthogonality_u_deg, "orthogonality", str(number), "first"),
             self._draw(stated.orthogonality_u_deg, "orthogonality", str(number), "second"))
            for number in range(1, len(fixture.axes))
        ]  # fmt: skip
        return tilted(fixture, (east_deg, 0.0, azimuth_deg), apart)

    def _arm_m(self, place: str, entry: PlaceEntry) -> Vector:
        """True position of the sensor: that of the bench file with errors drawn from its uncertainty."""
        if entry.arm is None:
            return NOWHERE
        u_m = entry.arm.U / entry.arm.k
        at_m = zip(entry.arm.vector_m, "xyz", strict=True)
        x_m, y_m, z_m = (stated_m + self._draw(u_m, place, "arm", axis) for stated_m, axis in at_m)
        return x_m, y_m, z_m

    def _table(self, table: TableSimulation) -> TableErrors:
        """Errors of the table; its base level has the same u about both axes."""
        stated = self._stated
        phases = stream(self._seed, "bench", "table", "ripple").uniform(0, 2 * math.pi, 3)
        wobble = complex(
            *(self._draw(stated.head.wobble_u_deg, "table", "wobble", shape) for shape in ("cosine", "sine"))
        )
        return TableErrors(
            loop=Loop(table.loop, table.damping, math.degrees(table.torque / table.inertia)),
            ripple=Ripple(table.ripple, (1, 2, 2 * table.pole_pairs), tuple(phases.tolist())),
            rate=self._draw(table.rate, "table", "rate"),
            across_deg=self._draw(stated.level_u_deg, "level", "across"),
            wobble_deg=abs(wobble),
            wobble_phase_rad=-cmath.phase(wobble),
        )


def _chamber(bench: BenchFile) -> ChamberPhysics:
    chamber = bench.simulation.chamber
    return ChamberPhysics(
        start_c=chamber.start,
        natural_period_s=chamber.natural_period,
        damping=chamber.damping,
        limit_cycle_c=chamber.limit_cycle,
        limit_cycle_period_s=chamber.limit_cycle_period,
    )


def columns(table: CorrectionTable | None) -> Table:
    """Return a table of corrections in the form of the simulated world."""
    return (tuple(table.at.tolist()), tuple(table.add.tolist())) if table is not None else ((), ())


def simulated_mount(mount: Mount) -> attitude.Mount:
    """Return a mount in the form of the simulated world."""
    return attitude.Mount(mount.angle, mount.roll, mount.clock)


def current_errors(bench: BenchFile, role: str, seed: int) -> CurrentErrors:
    """Errors of a source or an ammeter, drawn from its certificate, otherwise from `simulation` in the bench file."""
    certified, own = bench_record(bench).sources.get(role), bench.simulation.sources.get(role, SourceSimulation())

    def draw(error: str, certified_u: float, otherwise: float) -> float:
        return float((certified_u or otherwise) * stream(seed, "bench", role, error).standard_normal())

    return CurrentErrors(
        gain=draw("gain", certified.gain_u if certified else 0.0, own.gain),
        offset_a=draw("offset", certified.offset_u_a if certified else 0.0, own.offset),
        drift_per_h=draw("drift", certified.drift_u_per_s * HOUR_S if certified else 0.0, own.drift),
        fresh=own.fresh,
        warm_up_s=own.warm_up,
    )


def ammeter_input(bench: BenchFile, role: str, world: World, seed: int) -> CurrentInSeries:
    """Return the current through an ammeter from the places of the bench, and its errors. Raises InputError."""
    source = bench.in_series(role)
    if source is None:
        raise InputError(f"no place of the bench has '{role}' in the cable of its source: write there ammeter: {role}")
    table = columns(corrections_of(bench).currents.get(role))
    noise_a = bench.simulation.ammeters[role].noise if role in bench.simulation.ammeters else 0.0
    errors = replace(current_errors(bench, role, seed), fresh=1.0)  # it has been on for days
    return CurrentInSeries(world, source, errors, table, noise_a)


def encoder_skew_s(bench: BenchFile, role: str, seed: int) -> float:
    """Return the delay from the end of a sample to the latch of an encoder in s, drawn from the certificate."""
    known = bench.devices[role].calibration
    u_s = getattr(known.U, "encoder_skew", 0.0) / known.k if known is not None else 0.0
    return float(u_s * stream(seed, "bench", role, "encoder skew").standard_normal())


def voltmeter_settings(bench: BenchFile, role: str, seed: int) -> VoltmeterSettings:
    """Return the input of a voltmeter, and its errors drawn from its certificate. Raises InputError."""
    connected, certificate = bench.simulation.voltmeters.get(role), bench.devices[role].calibration
    if connected is None:
        raise InputError(f"nothing is connected to '{role}': add it to simulation.voltmeters of the bench file")

    def draw(error: str) -> float:
        """Return the residual of an error after the correction of the certificate."""
        if certificate is None:
            return 0.0
        sd, corrected = getattr(certificate.U, error) / certificate.k, getattr(certificate.corrections, error)
        return float(sd * stream(seed, "bench", role, error).standard_normal() - corrected)

    return VoltmeterSettings(connected.place or "", connected.load, draw("gain"), draw("offset"), connected.noise)
