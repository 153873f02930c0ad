"""Methods M3b and M3d: gain and phase of a gyro and of an accelerometer over frequency (equations 5.3, 5.5).

Every frequency is a separate acquisition, while the table oscillates. The encoder is latched with the pulses, or with
the samples that a unit sends, so that the phase between them depends on no clock except for the time between the two
latches. A sample is a mean over its period: its delay of half a period is corrected.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.methods.rate_table.reduction import waveform
from bench.methods.rate_table.reduction.assembly import each_sensor
from bench.methods.rate_table.reduction.chirp import chirp_points, swept_windows
from bench.methods.rate_table.reduction.converter_hysteresis import too_few_pulses, without_hysteresis
from bench.methods.rate_table.reduction.intake import table_samples
from bench.methods.rate_table.reduction.lever_arm import (
    SHORT_ARM_M,
    AccelerometerSweep,
    LeverArm,
    OnArm,
    accelerometer_point,
    lever_arm,
)
from bench.methods.rate_table.reduction.response_findings import ResponseFindings
from bench.methods.rate_table.reduction.response_points import (
    OFF_FREQUENCY,
    FrequencyResponse,
    Remarks,
    SweepPoint,
    at_frequency,
    frequency_response,
    gyro_point,
)
from bench.methods.rate_table.reduction.samples import TableSamples, mean_c
from bench.methods.rate_table.reduction.sampling import instantaneous
from bench.methods.rate_table.reduction.second_order import response_model
from bench.methods.rate_table.reduction.stated_scale import of_stated_scale, stated_scale
from bench.methods.rate_table.reduction.waveform import shown_point
from bench.metrology.acquisition import Motion
from bench.metrology.calibration.response import ResponseCompensation
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.curves import Constant, Equation
from bench.metrology.results.finding import UnitResult
from bench.metrology.results.flag import INVALID, Flag
from bench.metrology.run_data import RunData, UnitUnderTest

ARM_U = 3.0  # maximum difference of an arm from the bench file, in standard uncertainties
PointOf = Callable[[TableSamples, float, Remarks], SweepPoint | None]


def reduce_gyro(data: RunData, settings: Mapping[str, Any]) -> list[UnitResult]:
    """Reduce a run to gain, phase and bandwidth of every gyro against the rate of the table."""
    return each_sensor(data, settings, "gyro", _gyro)


def reduce_accelerometer(data: RunData, settings: Mapping[str, Any]) -> list[UnitResult]:
    """Reduce a run to arms, gain, phase and bandwidth of every accelerometer against the acceleration by the table."""
    return each_sensor(data, settings, "acc", _accelerometer)


def _gyro(data: RunData, unit: UnitUnderTest, settings: Mapping[str, Any]) -> UnitResult:
    scale = stated_scale(unit, settings, "°/s")

    def point_of(samples: TableSamples, nominal_hz: float, remarks: Remarks) -> SweepPoint | None:
        return gyro_point(samples.swing(1 / scale.value), nominal_hz, remarks)

    sweep = _Sweep.of(data, unit, settings["play_pulses"])
    swings = {hz: samples for hz, samples in sweep.swings.items() if not _is_lever(hz, settings["lever_hz"])}
    points = sweep.with_chirps(sweep.points(swings, point_of), 1 / scale.value)
    to_lowest = settings["gain_reference"] == "lowest"
    found = frequency_response(points, sweep.remarks, to_lowest=to_lowest)
    shown = shown_point(points, found, settings["waveform_hz"], sweep.swings)
    if shown is not None:
        found = replace(found, waveform=waveform.of_gyro(sweep.swings[shown.nominal_hz], shown, 1 / scale.value))
    findings = ResponseFindings(
        data, unit, sweep.steps, points, found, to_lowest=to_lowest, averaged_s=sweep.averaged_s
    )
    return sweep.result(points, found, findings, "°/s", scale)


def _accelerometer(data: RunData, unit: UnitUnderTest, settings: Mapping[str, Any]) -> UnitResult:
    scale = stated_scale(unit, settings, "g")
    sweep, per_pulse = _Sweep.of(data, unit, settings["play_pulses"]), 1 / scale.value
    lever_hz = settings["lever_hz"]
    what = AccelerometerSweep(data.bench.gravity_mps2, None, lever_hz)
    levers = [hz for hz in sweep.swings if _is_lever(hz, lever_hz)]
    swings = {hz: samples for hz, samples in sweep.swings.items() if hz not in levers}
    arm: LeverArm | None = None
    of_scale: tuple[BudgetLine, ...] = ()
    if levers:
        samples = sweep.swings[levers[0]]
        of_scale = of_stated_scale(samples.temperature_c, settings, data, unit)
        arm = lever_arm(samples.swing(per_pulse), what, sweep.remarks)
    if arm is None:
        sweep.leave_out(lever_hz)
    elif abs(arm.y_m) < SHORT_ARM_M:
        sweep.remarks.flags.append(Flag("lever_arm_short"))
    elif _unlike(arm, unit, float(np.linalg.norm([line.u for line in of_scale]))):
        sweep.remarks.flags.append(Flag("lever_arm_unlike_bench_file"))
    points: list[SweepPoint] = []
    if arm is not None and max(abs(arm.x_m), abs(arm.y_m)) >= SHORT_ARM_M:
        known = arm

        def point_of(samples: TableSamples, nominal_hz: float, remarks: Remarks) -> SweepPoint | None:
            return accelerometer_point(samples.swing(per_pulse), nominal_hz, known, what, remarks)

        points = sweep.with_chirps(sweep.points(swings, point_of), per_pulse, OnArm(known, data.bench.gravity_mps2))
    found = frequency_response(points, sweep.remarks)
    shown = shown_point(points, found, settings["waveform_hz"], sweep.swings)
    if arm is not None and shown is not None:
        on = OnArm(arm, data.bench.gravity_mps2)
        found = replace(found, waveform=waveform.of_accelerometer(sweep.swings[shown.nominal_hz], shown, per_pulse, on))
    findings = ResponseFindings(
        data, unit, sweep.steps, points, found, arm=arm, of_scale=of_scale,
        warmer=_warmer(sweep, levers, settings["scale_per_c_u"]), averaged_s=sweep.averaged_s,
    )  # fmt: skip
    return sweep.result(points, found, findings, "g", scale)


def _is_lever(frequency_hz: float, lever_hz: float | None) -> bool:
    return lever_hz is not None and bool(np.isclose(frequency_hz, lever_hz, rtol=1e-6))


def _warmer(sweep: _Sweep, levers: list[float], per_c: float) -> dict[float, float]:
    """Relative difference of the scale factor from that at the lever frequency, because the unit has warmed."""
    if not levers:
        return {}
    lever_c = sweep.swings[levers[0]].temperature_c
    return {hz: float(np.nan_to_num(abs(each_c - lever_c))) * per_c for hz, each_c in sweep.temperatures_c.items()}


def _unlike(arm: LeverArm, unit: UnitUnderTest, scale_u: float) -> bool:
    """True if an arm differs from the bench file, as for a unit in another place or orientation."""
    if unit.arm_m is None:
        return False
    return any(
        abs(found_m - stated_m) > ARM_U * np.hypot(np.hypot(u_m, unit.arm_u_m), scale_u * found_m)
        for found_m, stated_m, u_m in ((arm.x_m, unit.arm_m[0], arm.u_x_m), (arm.y_m, unit.arm_m[1], arm.u_y_m))
    )


@dataclass(slots=True)
class _Sweep:
    """Oscillations of a unit by frequency, lowest first, and the steps of their acquisitions."""

    unit: UnitUnderTest
    swings: dict[float, TableSamples]
    steps: dict[float, str]
    remarks: Remarks
    left_out: list[str]
    left_out_hz: list[float]
    temperatures_c: dict[float, float]
    play_pulses: float
    chirps: list[tuple[TableSamples, Motion]]

    @classmethod
    def of(cls, data: RunData, unit: UnitUnderTest, play_pulses: float) -> _Sweep:
        """Collect the oscillations of a unit; of a repeated frequency the last one counts."""
        sweep = cls(unit, {}, {}, Remarks(), [], [], {}, play_pulses if unit.is_counted else 0.0, [])
        found: dict[float, TableSamples] = {}
        for acquisition in data.acquisitions:
            samples, motion = table_samples(acquisition, unit), acquisition.motion
            problems = list(samples.problems)
            if motion is None or (motion.frequency_hz is None and not motion.sweep_hz):
                problems.append("not_swinging")
            if motion is not None and motion.sweep_hz and not problems:
                sweep.chirps.append((samples, motion))
            elif problems or motion is None or motion.frequency_hz is None:
                sweep.left_out.append(acquisition.step.partition("/")[2])
                sweep.remarks.flags += [Flag(problem, at=acquisition.step) for problem in problems]
            else:
                found[motion.frequency_hz] = without_hysteresis(samples, motion.frequency_hz, sweep.play_pulses)
        for hz, samples in sorted(found.items()):
            if too_few_pulses(samples.stroke, sweep.play_pulses):
                sweep.leave_out(hz, "few_pulses")
            else:
                sweep.swings[hz] = samples
        sweep.steps = {hz: samples.step for hz, samples in sweep.swings.items()}
        sweep.temperatures_c = {hz: samples.temperature_c for hz, samples in sweep.swings.items()}
        return sweep

    @property
    def averaged_s(self) -> float:
        """Averaging time of samples; 0 for pulses and for instantaneous samples."""
        found = next(iter([*self.swings.values(), *(samples for samples, _ in self.chirps)]), None)
        return found.interval_s if found is not None and found.sampled not in (None, instantaneous) else 0.0

    def with_chirps(self, points: list[SweepPoint], per_pulse: float, on: OnArm | None = None) -> list[SweepPoint]:
        """Return the points and those of continuous sweeps, by frequency; constant frequencies come first."""
        known = {point.nominal_hz for point in points}
        for samples, motion in self.chirps:
            windows = list(swept_windows(samples, motion, self.play_pulses))
            if not windows:
                self.remarks.flags.append(Flag("not_swept", at=samples.step))
                self.left_out.append(samples.step.partition("/")[2])
            few = [window for window in windows if too_few_pulses(window.stroke, self.play_pulses)]
            for window in few:
                self.leave_out(window.nominal_hz, "few_pulses")
            enough = [window for window in windows if window not in few]
            found = chirp_points(enough, samples, motion, per_pulse, on)
            for point in (each for each in found if each.nominal_hz not in known):
                known.add(point.nominal_hz)
                points.append(point)
                self.steps[point.nominal_hz] = samples.step
                self.temperatures_c[point.nominal_hz] = samples.temperature_c
        return sorted(points, key=lambda point: point.nominal_hz)

    def leave_out(self, frequency_hz: float, problem: str = INVALID) -> None:
        """Leave out a frequency without a result, for the first problem that it has."""
        if frequency_hz not in self.left_out_hz:
            self.left_out_hz.append(frequency_hz)
            self.remarks.flags.append(at_frequency(problem, frequency_hz))
            self.left_out.append(f"{frequency_hz:g} Hz")

    def points(self, swings: Mapping[float, TableSamples], point_of: PointOf) -> list[SweepPoint]:
        """Responses at the frequencies that determine one."""
        found = []
        for nominal_hz, samples in swings.items():
            point = point_of(samples, nominal_hz, self.remarks)
            if point is None:
                self.leave_out(nominal_hz)
                continue
            found.append(point)
            if point.swing.few_phases:
                self.remarks.flags.append(at_frequency("few_phases", nominal_hz))
            if abs(point.swing.frequency_hz / nominal_hz - 1) > OFF_FREQUENCY:
                self.remarks.flags.append(at_frequency("off_frequency", nominal_hz))
        return found

    def result(
        self, points: list[SweepPoint], found: FrequencyResponse, findings: ResponseFindings, symbol: str,
        scale: Constant,
    ) -> UnitResult:  # fmt: skip
        """Results of the unit; `scale` is the stated scale factor, for values in the unit `symbol`."""
        flags = [Flag("no_response") if flag.code == INVALID else flag for flag in self.remarks.flags]
        held = {point.frequency_hz for point in found.points}
        not_held = [*self.left_out_hz, *(point.nominal_hz for point in points if point.nominal_hz not in held)]
        if found.bandwidth.status == "not_reached" and max(not_held, default=0.0) > max(held):
            flags.append(Flag("bandwidth_left_out", values={"frequency": f"{max(held):g}"}))
        elif found.bandwidth.status in ("not_reached", "below_at_start"):
            flags.append(Flag(f"bandwidth_{found.bandwidth.status}"))
        if found.bandwidth.crossings > 1:
            flags.append(Flag("several_crossings"))
        if not points:
            self.left_out.append("response")
        model = response_model(
            [point for point in points if point.nominal_hz in held], findings.model_id, findings.skew
        )
        return UnitResult(
            place=self.unit.place, uut=self.unit.serial, findings=tuple(findings.findings()),
            models=(model,) if model is not None else (), left_out=tuple(self.left_out),
            flags=tuple(dict.fromkeys(flags)), detail=found,
            compensations=self._compensations(model, symbol, scale),
        )  # fmt: skip

    def _compensations(self, model: Equation | None, symbol: str, scale: Constant) -> tuple[ResponseCompensation, ...]:
        if model is None:
            return ()
        channel = f"{self.unit.measured_by}@response"
        found_at_c = mean_c(list(self.temperatures_c.values()))
        return (ResponseCompensation.of_model(model, channel, (self.unit.output_unit, symbol), scale, found_at_c),)
