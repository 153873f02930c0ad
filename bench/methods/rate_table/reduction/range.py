"""Methods M3a and M3c: errors of a gyro and of an accelerometer over their range (equations 5.2 and 5.4).

A gyro is compared with the rate of the table, an accelerometer with ω²r with the radius that it determines itself at
low rates. The counter's clock is common to the rates of pulses and table, and cancels; codes and volts depend on no
clock.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bench.methods.rate_table.reduction.assembly import each_sensor
from bench.methods.rate_table.reduction.radius import LEAST_LOW_RATES, Arm, gyro_error
from bench.methods.rate_table.reduction.range_findings import BY_RADIUS, PointError, RangeFindings, noise_of
from bench.methods.rate_table.reduction.range_points import RangeBlocks, Turning, range_blocks
from bench.metrology.orientation import turned_axes
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Finding, UnitResult
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import RunData, UnitUnderTest

RESOLUTION = "encoder: resolution"
HARMONICS = "encoder: errors over part of a turn"
ARM_U = 3.0  # maximum difference of a radius from the bench file, in standard uncertainties
TOUCH_G = 1.02  # of the highest acceleration for the radius: tolerance for a rate that is slightly too fast


def reduce_gyro(data: RunData, settings: Mapping[str, Any]) -> list[UnitResult]:
    """Reduce a run to bias and errors of every gyro; rates in °/s by the stated scale factor."""
    return each_sensor(data, settings, "gyro", _gyro)


def reduce_accelerometer(data: RunData, settings: Mapping[str, Any]) -> list[UnitResult]:
    """Reduce a run to bias, radius and errors of every accelerometer; in local g by the stated scale factor."""
    return each_sensor(data, settings, "acc", _accelerometer)


def _gyro(data: RunData, unit: UnitUnderTest, settings: Mapping[str, Any]) -> UnitResult:
    blocks = range_blocks(data, unit, 1 / settings["scale"][unit.output_unit], settings["clip_dps"])
    form = RangeFindings(data, unit, settings, "rate_error", "°/s", settings["full_scale_dps"])
    if blocks.rest is None:
        return form.result(blocks, [], None)
    rest = form.at_rest(blocks, "rest_rate", "mean rate at rest, earth's part included")
    points = []
    for number, turning in enumerate(blocks.turning):
        error = gyro_error(turning.steady, blocks.bias)
        lines = [
            form.noise(turning),
            *form.of_rest(blocks, 1.0),
            BudgetLine(RESOLUTION, "B", error.by_rate),
            BudgetLine(HARMONICS, "B", turning.u_harmonics_dps, None, "table.harmonics"),
            *form.of_the_voltmeter(error.true),
            *form.of_the_clock(error.true),
        ]
        at = {"point": number, "rate_dps": turning.command_dps}
        if np.isfinite(turning.temperature_c):
            at["at_c"] = turning.temperature_c
        points.append(PointError(turning, at, error.true, error.value, lines))
    return form.with_curve(blocks, [rest], "rate", points, ("scale_error", "asymmetry", "cubic"))


def _accelerometer(data: RunData, unit: UnitUnderTest, settings: Mapping[str, Any]) -> UnitResult:
    per_pulse = 1 / settings["scale"][unit.output_unit]
    blocks = range_blocks(data, unit, per_pulse, settings["clip_g"], feels_gravity=True)
    form = RangeFindings(data, unit, settings, "acceleration_error", "g", settings["full_scale_g"])
    if blocks.rest is None:
        return form.result(blocks, [], None)
    rest = form.at_rest(blocks, "rest_output", "mean output at rest")
    highest_g = settings["radius_up_to_g"] * TOUCH_G
    low = [each for each in blocks.turning if abs(each.steady.output - blocks.bias.output) <= highest_g]
    runs = [each for each in blocks.turning if all(each is not used for used in low)]
    usable = [each for each in low if form.stable(each)]
    if len({round(abs(each.command_dps), 3) for each in usable}) < LEAST_LOW_RATES:
        blocks.flags.append(Flag("too_few_low_rates"))
        blocks.left_out.append("radius")
        return form.result(blocks, [rest], None)
    arm = Arm(blocks.bias, [each.steady for each in usable], data.bench.gravity_mps2)
    radius = _radius(form, blocks, usable, arm)
    if _unlike(radius, usable[0], unit, data):
        blocks.flags.append(Flag("radius_unlike_bench_file"))
    if arm.is_uncertain:
        blocks.flags.append(Flag("radius_not_determined"))
        blocks.left_out.append("radius")
        return form.result(blocks, [rest, radius], None)
    points = []
    for number, turning in enumerate(runs):
        error = arm.error(turning.steady)
        lines = [
            form.noise(turning),
            *form.of_rest(blocks, error.per_bias),
            BudgetLine(BY_RADIUS, "A", error.by_radius, None, form.subject.id("radius")),
            BudgetLine(RESOLUTION, "B", error.by_rate),
            BudgetLine(HARMONICS, "B", abs(2 * error.true / turning.steady.rate_dps) * turning.u_harmonics_dps),
            form.warmer(abs(error.true) * form.settings["scale_per_c_u"] * _warmer_c(turning, usable)),
            *form.of_the_voltmeter(error.value),
            BudgetLine("stretch of the arm: contained", "alias", 0.0),
        ]
        at = {"point": number, "rate_dps": turning.command_dps, "acceleration_g": error.true}
        points.append(PointError(turning, at, error.true, error.value, lines))
    return form.with_curve(blocks, [rest, radius], "acceleration", points, ("scale_error", "quadratic"))


def _warmer_c(turning: Turning, low: Sequence[Turning]) -> float:
    """Temperature of the unit relative to that at the low rates; 0 if unknown."""
    difference_c = abs(turning.temperature_c - float(np.mean([each.temperature_c for each in low])))
    return float(np.nan_to_num(difference_c))


def _unlike(radius: Finding, low: Turning, unit: UnitUnderTest, data: RunData) -> bool:
    """True if the radius differs from that of the bench file: another scale factor than stated, or another place."""
    if unit.arm_m is None:
        return False
    mount = next(each.mount for each in data.acquisitions if each.step == low.step)
    input_axis = turned_axes((), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), mount, (unit.mount_angle_deg, 0.0))[0]
    stated_m = -float(input_axis @ np.array(unit.arm_m))
    return abs(radius.value - stated_m) > ARM_U * float(np.hypot(radius.u, unit.arm_u_m))


def _radius(form: RangeFindings, blocks: RangeBlocks, low: Sequence[Turning], arm: Arm) -> Finding:
    """Finding of the arm as measured by the sensor itself; it contains the error of the scale factor."""
    radius_m = arm.radius_m
    weights = np.array([each.steady.rate_dps**4 for each in low])
    harmonics = weights / weights.sum() * [2 * each.u_harmonics_dps / each.steady.rate_dps for each in low]
    lines = [
        BudgetLine(noise_of(form.unit, "low rates"), "A", arm.u_own_m),
        *form.of_rest(blocks, arm.per_bias_m),
        BudgetLine(HARMONICS, "B", abs(radius_m) * float(np.linalg.norm(harmonics))),
        *form.as_stated(radius_m, float(np.mean([each.temperature_c for each in low]))),
        form.data.bench.gravity(radius_m),
        form.time_base(radius_m if form.unit.is_counted else 2 * radius_m),  # pulses are counted by the same clock
        *form.of_the_voltmeter(radius_m),
        BudgetLine("second-order nonlinearity of the sensor at low rates: contained", "alias", 0.0),
    ]
    name = "from the axis to the sensor, positive where its input axis points at the axis"
    return form.subject.finding("radius", name, radius_m, "m", lines, {}, tuple(each.step for each in low))
