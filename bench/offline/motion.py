"""Specific force or velocity of a calibrated unit from a record of its output, counted or sampled."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TextIO

import numpy as np
from numpy.typing import NDArray

from bench.errors import InputError
from bench.metrology.calibration.temperature import Beyond, Compensation
from bench.metrology.velocity import Gravity, SpecificForce, integrate, specific_forces
from bench.offline.calibration_file import CalibrationFile
from bench.offline.count_series import read_counts
from bench.offline.motion_series import Series
from bench.offline.sample_series import read_samples
from drivers.quantity.quantities import parse
from drivers.quantity.units import QuantityError

COUNTED, FORCE = "pulse/s", "g"
STEADY_S = 1.0  # at rest at the beginning of a record, for the check of its first specific force
STEADY_G = 0.02
MOST_G = 1000.0  # no sensor of these methods measures more
LINES = 2**14  # written at once
Array = NDArray[np.float64]
Column = tuple[str, str, NDArray[np.float64] | NDArray[np.bool_]]  # name, format, values (n,)


@dataclass(frozen=True, slots=True)
class Wanted:
    """Result of a record: its kind, the unit of acceleration, and how it is computed.

    `noise_g` is the density of the sensor's white noise in g/√Hz, `at_start_g` the specific forces of channels in the
    first second, at which the unit is at rest.
    """

    to: Literal["acceleration", "velocity"]
    unit: Literal["g", "m/s²"] = "g"
    beyond: Beyond = "hold"
    counter_bits: int | None = None
    noise_g: float = 0.0
    at_start_g: Mapping[str, float] | None = None


def wanted(
    to: str, unit: str, beyond: str, counter_bits: int | None, noise: str | None, at_start: Sequence[str]
) -> Wanted:
    """The wanted result by the options of a command. Raises InputError."""
    starts = [each.partition("=") for each in at_start]
    try:
        noise_g = 0.0 if noise is None else parse(noise).to("g/Hz^0.5")
        at_start_g = {channel: float(value) for channel, _, value in starts}
    except QuantityError as problem:
        raise InputError(f'--noise "{noise}": {problem}') from None
    except ValueError:
        raise InputError(f"--at-start {' '.join(at_start)}: expected CHANNEL=G, such as x=1 or acc_z=-1") from None
    return Wanted(
        "velocity" if to == "velocity" else "acceleration", "g" if unit == "g" else "m/s²",
        "hold" if beyond == "hold" else "reject", counter_bits, abs(noise_g), at_start_g,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Motion:
    """Columns of a result, each (n,), and remarks for the user."""

    columns: Sequence[Column]
    remarks: Sequence[str]

    def write(self, file: TextIO) -> None:
        """Write the columns as CSV; what is not known is blank."""
        file.write(",".join(name for name, _, _ in self.columns) + "\n")
        row = ",".join(form for _, form, _ in self.columns) + "\n"
        for begin in range(0, len(self.columns[0][2]), LINES):
            part = np.column_stack([values[begin : begin + LINES] for _, _, values in self.columns])
            file.write((row * len(part) % tuple(part.ravel().tolist())).replace("nan", ""))


def in_motion(calibration: CalibrationFile, data: Path, wanted: Wanted) -> Motion:
    """Convert a CSV file of counts or samples by a calibration.

    Raises InputError, also where a check of the record fails.
    """
    axes = axes_of(calibration)
    is_warm = any(known.valid_c is not None for known in axes.values())
    if is_counted(axes):
        series = read_counts(data, list(axes), wanted.counter_bits, is_warm=is_warm)
    else:
        series = read_samples(data, axes, is_warm=is_warm)
    return converted(calibration, data.name, series, wanted)


def converted(calibration: CalibrationFile, name: str, series: Series, wanted: Wanted) -> Motion:
    """Convert a record, called `name` in messages, as `in_motion` does."""
    axes = axes_of(calibration)
    if wanted.counter_bits is not None and not series.is_counted:
        raise InputError(f"{name}: --counter-bits is for counts; the calibration is of samples, which do not wrap")
    forces = specific_forces(series.record, axes, wanted.beyond)
    for channel, force in forces.items():
        _expect_plausible(name, axes[channel], force)
    for channel, value_g in (wanted.at_start_g or {}).items():
        _expect_at_start(name, channel, forces, value_g, counted=series.is_counted)
    gravity = Gravity(calibration.gravity_mps2, calibration.u_gravity_mps2)
    if not gravity.mps2 > 0 and (wanted.to == "velocity" or wanted.unit != "g"):
        raise InputError(f"{name}: the calibration states no gravity, so that m/s² cannot be had from its g")
    outside = np.any([force.outside for force in forces.values()], axis=0)
    columns: list[Column] = [("t_s", "%.12g", series.record.time_s)]
    for channel, force in forces.items():
        columns += _columns(channel, force, gravity, wanted)
    marks = {"extrapolated": np.concatenate(([False], outside)), "gap": series.gap, "glitch": series.glitch}
    columns += [(name, "%d", mask) for name, mask in marks.items()]
    remarks = [*remarks_on(series, marks["extrapolated"]), *_beyond_inputs(axes, forces)]
    return Motion(columns, [f"{name}: {remark}" for remark in remarks])


def is_counted(axes: Mapping[str, Compensation]) -> bool:
    """True if the outputs of channels are counted, false if they are sampled."""
    return all(known.output_unit == COUNTED for known in axes.values())


def axes_of(calibration: CalibrationFile) -> dict[str, Compensation]:
    """Channels with force terms, counted or sampled alike. Raises InputError without one."""
    known = calibration.over_temperature()
    axes = {
        name: each
        for name, each in known.items()
        if each.force is not None and each.value_unit == FORCE and (each.output_unit == COUNTED or each.force.sample)
    }
    if not axes:
        has = ", ".join(f"{name} ({each.output_unit} to {each.value_unit})" for name, each in known.items())
        raise InputError(
            f"the calibration of {calibration.uut} gives no specific force. That of a channel (M0) does if it has "
            f"levels of gravity and of a source, that of an inertial unit (M2) if it is counted. It has {has}"
        )
    kinds = {each.force.sample for each in axes.values() if each.force}
    if len(kinds) > 1:
        raise InputError(
            f"the calibration of {calibration.uut} has channels of several kinds of output: {', '.join(axes)}. Their "
            "samples are not of one record"
        )
    lacking = {other for each in axes.values() if each.force for other in each.force.cross if other not in axes}
    if lacking:
        raise InputError(f"the calibration of {calibration.uut} lacks {', '.join(sorted(lacking))}, for cross-coupling")
    return axes


def _columns(channel: str, force: SpecificForce, gravity: Gravity, wanted: Wanted) -> Iterator[Column]:
    """Value and standard uncertainty of a channel."""
    if wanted.to == "velocity":
        found = integrate(force, gravity, wanted.noise_g)
        value, u, unit = found.velocity_mps, found.u_mps, "mps"
    elif wanted.unit == "g":
        value, u, unit = _at_end(force.force_g), _at_end(force.u_g(wanted.noise_g)), "g"
    else:
        value, unit = _at_end(gravity.mps2 * force.force_g), "mps2"
        u = _at_end(force.u_mps2(gravity, wanted.noise_g))
    yield f"{channel}_{unit}", "%.10g", value
    yield f"u_{channel}_{unit}", "%.4g", u


def _at_end(of_intervals: Array) -> Array:
    """Values of intervals on the rows that end them; the first row ends none."""
    return np.concatenate(([np.nan], of_intervals))


def _expect_plausible(file: str, known: Compensation, force: SpecificForce) -> None:
    usual_g = float(np.nanmedian(np.abs(force.force_g))) if np.isfinite(force.force_g).any() else 0.0
    if usual_g <= MOST_G:
        return
    would = f"{file}: channel {known.channel} would have {usual_g:.3g} g in half of the intervals"
    if known.output_unit == COUNTED:
        raise InputError(f"{would}; are the times in s, and are these the counts of this channel?")
    raise InputError(
        f"{would}; the calibration is of an output in {known.output_unit}: is the column in this unit, and are these "
        f"samples, not counts? Name it with its unit, such as {known.channel}_mV, if it is another one"
    )


def _expect_at_start(
    file: str, channel: str, forces: Mapping[str, SpecificForce], expected_g: float, *, counted: bool
) -> None:
    """Raise InputError if the mean of the first second is not what the user knows it to be."""
    if channel not in forces:
        raise InputError(
            f"--at-start {channel}: there is no channel '{channel}'; the calibration has {', '.join(forces)}"
        )
    force = forces[channel]
    first = np.cumsum(force.seconds) <= max(STEADY_S, float(force.seconds[0]))
    found_g = float(np.average(force.force_g[first], weights=force.seconds[first]))
    if abs(found_g - expected_g) <= STEADY_G:
        return
    why = "is the unit at rest there, and are these the output and the calibration of this unit?"
    if abs(found_g + expected_g) <= STEADY_G:
        lines = (
            f"are {channel}_pos and {channel}_neg exchanged" if counted else "are both lines of the output exchanged"
        )
        why = f"the sign is another: {lines}, or is the axis the other way up?"
    elif counted and abs(1000 * found_g - expected_g) <= STEADY_G:
        why = "are the times of t_s in ms?"
    raise InputError(f"{file}: channel {channel} begins with {found_g:.6g} g, not with {expected_g:g} g; {why}")


_COUNTED = (
    "readings are missing before the row; the counters went on",
    "a counter may have wrapped unnoticed; a velocity is blank from there on",
    "the rate of one interval differs from those before and after it: lost or extra pulses",
)
_SAMPLED = (
    "samples are missing before the row; the output is taken to be between its neighbours",
    "too many samples are missing before the row; a velocity is blank from there on",
    "one sample differs from those before and after it",
)


def remarks_on(series: Series, extrapolated: NDArray[np.bool_]) -> Iterator[str]:
    """Remarks on rows that were left out or are marked."""
    time_s = series.record.time_s
    if series.left_out:
        yield f"{series.left_out} rows without a time or an output were left out"
    of_kind = _COUNTED if series.is_counted else _SAMPLED
    for marked, what in (
        (extrapolated, "the temperature is outside of the range of the calibration"),
        *zip((series.gap, series.lost, series.glitch), of_kind, strict=True),
    ):
        rows = np.flatnonzero(marked)
        if len(rows):
            yield f"{len(rows)} rows from t_s = {time_s[rows[0]]:.12g} on: {what}"


def _beyond_inputs(axes: Mapping[str, Compensation], forces: Mapping[str, SpecificForce]) -> Iterator[str]:
    """Remarks on specific forces beyond those of the calibration."""
    for channel, known in axes.items():
        found_g = forces[channel].force_g
        if known.force is None or not np.isfinite(found_g).any():
            continue
        (low_g, high_g), least_g, most_g = known.force.valid_g, float(np.nanmin(found_g)), float(np.nanmax(found_g))
        if least_g < low_g - STEADY_G or most_g > high_g + STEADY_G:
            yield (
                f"channel {channel}: from {least_g:.3g} to {most_g:.3g} g; the calibration was made from {low_g:.3g} "
                f"to {high_g:.3g} g. Beyond, only a quadratic term is known"
            )
