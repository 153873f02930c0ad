"""Sensors of an inertial unit on a rate table, each reduced as a unit of its own (equations 5.10).

In each mounting those gyros are measured whose input axes point along the axis of the table, and the accelerometers
across it, all from the same acquisitions: one latch holds all channels of the unit and the encoder. A unit that sends
samples takes all of them at once, and the encoder is latched with one of its channels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from bench.methods.rate_table.reduction.intake import encoder_of
from bench.metrology.acquisition import Acquisition, Array, Codes, Counts, Mount, Positions
from bench.metrology.bench_uncertainty import BenchRecord
from bench.metrology.orientation import turned_axes
from bench.metrology.outputs import mean_of, measured
from bench.metrology.results.finding import UnitResult
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import AXES, RunData, UnitUnderTest

Kind = Literal["acc", "gyro"]
Reduce = Callable[[RunData, UnitUnderTest, Mapping[str, Any]], UnitResult]
ALONG = 0.999  # cosine of the largest angle between an input axis and the axis of the table
ACROSS = float(np.sqrt(1 - ALONG**2))  # largest cosine of that angle for a level input axis
OFF_G = 0.5  # maximum difference of an accelerometer along the axis from gravity there
LEAST_COMMON = 0.5  # of the latches of a channel, those that the encoder has too
NOT_ONE_SWING, OTHER_MOUNTING, NO_SENSOR = "not_one_swing", "mounting_unlike_sequence", "{mount}: no_sensor"


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor in a mounting, as a unit of its own: `name` is acc_x to gyro_z, `mount` "" on a bench without mounts.

    Its arm is in the frame of the table, with the input axis along x.
    """

    name: str
    mount: str
    unit: UnitUnderTest


@dataclass(frozen=True, slots=True)
class Assembly:
    """Results of the sensors of a unit, in the order of the run."""

    parts: tuple[tuple[Sensor, UnitResult], ...]


def each_sensor(data: RunData, settings: Mapping[str, Any], kind: Kind, reduce: Reduce) -> list[UnitResult]:
    """Reduce each unit, and each gyro or accelerometer of an inertial unit with its own scale factor."""
    return [
        _assembly(data, unit, settings, kind, reduce) if unit.channels else reduce(data, unit, settings)
        for unit in data.units
    ]


def _assembly(
    data: RunData, unit: UnitUnderTest, settings: Mapping[str, Any], kind: Kind, reduce: Reduce
) -> UnitResult:
    flags: list[Flag] = []
    left_out: list[str] = []
    parts: list[tuple[Sensor, UnitResult]] = []
    for mount in dict.fromkeys(each.mount for each in data.acquisitions):
        acquired = [each for each in data.acquisitions if each.mount == mount]
        split = [each.step for each in acquired if not _is_one_swing(each, unit)]
        flags += [Flag(NOT_ONE_SWING, at=step) for step in split]
        left_out += [step.partition("/")[2] for step in split]
        used = [each for each in acquired if each.step not in split]
        if (step := _in_other_mounting(used, mount, unit, data.bench)) is not None:
            flags.append(Flag(OTHER_MOUNTING, at=step))
            left_out.append(step.partition("/")[2])
        sensors = list(_sensors(unit, mount, kind, data.bench))
        if not sensors:
            flags.append(Flag(NO_SENSOR, values={"mount": mount.name or "-"}))
            left_out.append(mount.name or unit.place)
        there = replace(data, acquisitions=tuple(replace(each, mount=Mount()) for each in used))
        for sensor in sensors:
            own = {**settings, "scale": settings["scale"].get(sensor.name, settings["scale"])}
            parts.append((sensor, reduce(_latched_with(there, sensor.unit), sensor.unit, own)))
    return _together(unit, parts, flags, left_out)


def _sensors(unit: UnitUnderTest, mount: Mount, kind: Kind, bench: BenchRecord) -> Iterator[Sensor]:
    """Gyros whose input axes point along the axis of the table, or accelerometers across it."""
    axes, up = _axes_and_up(unit, mount, bench)
    for letter, axis in zip(AXES, axes, strict=True):
        cosine = float(axis @ up)
        if cosine > ALONG if kind == "gyro" else abs(cosine) < ACROSS:
            name = f"{kind}_{letter}"
            own = replace(
                unit.alone(name), sensor="", place="/".join(filter(None, (unit.place, mount.name, name))),
                temperature=unit.thermometer(name), gyro_temperature="", temperatures={}, mount_angle_deg=0.0,
                arm_m=_arm_m(unit, axis, up),
            )  # fmt: skip
            yield Sensor(name, mount.name, own)


def _axes_and_up(unit: UnitUnderTest, mount: Mount, bench: BenchRecord) -> tuple[Array, Array]:
    """Axes of a unit (3, 3), a row each, and the direction of the table's axis (3,), in the frame of the fixture."""
    axes = turned_axes((), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), mount, (unit.mount_angle_deg, unit.clock_deg))
    fixture = np.array([bench.x, np.cross(bench.z, bench.x), bench.z])
    points = next((axis.points for axis in bench.axes.values()), (0.0, 0.0, 1.0))
    return axes, fixture @ np.array(points)


def _arm_m(unit: UnitUnderTest, axis: Array, up: Array) -> tuple[float, float, float] | None:
    """Stated arm of a unit in the frame of a sensor: along its input axis, across it, and along the table's axis."""
    if unit.arm_m is None:
        return None
    arm_m = np.array(unit.arm_m)
    return float(arm_m @ axis), float(arm_m @ np.cross(up, axis)), float(arm_m @ up)


def _latched_with(data: RunData, unit: UnitUnderTest) -> RunData:
    """Acquisitions of one swing, with the encoder as latched with the samples of this channel of the unit too."""
    if unit.telemetry is None:
        return data
    acquisitions = []
    for each in data.acquisitions:
        positions = {name: replace(encoder, channel=unit.telemetry) for name, encoder in each.positions.items()}
        acquisitions.append(replace(each, positions=positions))
    return replace(data, acquisitions=tuple(acquisitions))


def _is_one_swing(acquisition: Acquisition, unit: UnitUnderTest) -> bool:
    """True if all channels of a unit and the encoder have the same latches or samples: they record one motion."""
    if (encoder := encoder_of(acquisition)) is None:
        return True  # it is left out with a flag of its own
    recorded: dict[str, Counts | Codes] = {**acquisition.counts, **acquisition.codes}
    channels = [recorded.get(channel) for channel in unit.channels.values()]
    return all(each is not None and _same_latches(each, encoder) for each in channels)


def _same_latches(found: Counts | Codes, encoder: Positions) -> bool:
    """True if most latches or samples of a channel are those of the encoder, at the same ticks."""
    common, of_channel, of_encoder = np.intersect1d(
        found.sequence, encoder.sequence, assume_unique=True, return_indices=True
    )
    enough = len(common) >= LEAST_COMMON * max(len(found.sequence), len(encoder.sequence))
    return bool(enough) and bool(np.array_equal(found.tick[of_channel], encoder.tick[of_encoder]))


def _in_other_mounting(
    acquired: list[Acquisition], mount: Mount, unit: UnitUnderTest, bench: BenchRecord
) -> str | None:
    """Step of an acquisition in which an accelerometer along the axis of the table does not read gravity.

    Means over a motion contain no more than gravity along that axis. None if there is none, or if the bench file does
    not state the nominal scale factor.
    """
    if not unit.nominal_per_g:
        return None
    axes, up = _axes_and_up(unit, mount, bench)
    for letter, axis in zip(AXES, axes, strict=True):
        expected_g, sensor = float(axis @ up), unit.alone(f"acc_{letter}")
        for each in acquired if abs(expected_g) > ALONG else ():
            read_g = mean_of(measured(each, sensor)).value / unit.nominal_per_g
            if abs(read_g - expected_g) > OFF_G:
                return each.step
    return None


def _together(
    unit: UnitUnderTest, parts: list[tuple[Sensor, UnitResult]], flags: list[Flag], left_out: list[str]
) -> UnitResult:
    """Results of a unit with those of its sensors, named in the conditions of each finding.

    Its calibration has each sensor once: the first mounting counts.
    """
    named = [
        (sensor, replace(result, findings=tuple(
            replace(each, at={"sensor": sensor.name, "mount": sensor.mount, **each.at}) for each in result.findings
        )))
        for sensor, result in parts
    ]  # fmt: skip
    compensations = {
        name: replace(each, channel=name)
        for sensor, result in reversed(named)
        for each in result.compensations
        for name in (sensor.name + each.channel.removeprefix(sensor.unit.measured_by),)
    }
    results = [result for _, result in named]
    return UnitResult(
        place=unit.place,
        uut=unit.serial,
        findings=tuple(each for result in results for each in result.findings),
        models=tuple(each for result in results for each in result.models),
        left_out=(*left_out, *(each for result in results for each in result.left_out)),
        flags=tuple(dict.fromkeys([*flags, *(each for result in results for each in result.flags)])),
        detail=Assembly(tuple(named)),
        compensations=tuple(compensations.values()),
    )
