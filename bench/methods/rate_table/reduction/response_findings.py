"""The findings of a frequency response, each with its budget (equations 1.9).

A gain is the ratio of a sine of the sensor to one of the encoder, both counted on one clock, which cancels. The scale
factor and gravity are in the arms of an accelerometer, not in its gains: these are relative to that at the lever
frequency. The errors of the encoder over a turn change the amplitude of a swing by their slope, less for a wide swing
than for a narrow one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import j1

from bench.methods.rate_table.reduction.lever_arm import LeverArm
from bench.methods.rate_table.reduction.range_findings import noise_of
from bench.methods.rate_table.reduction.response_points import (
    HALF_POWER,
    FrequencyResponse,
    ResponsePoint,
    SweepPoint,
    Swing,
)
from bench.metrology.bench_uncertainty import AxisRecord, ClockRecord
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Finding, Subject
from bench.metrology.run_data import RunData, UnitUnderTest

ENCODER = "encoder: noise and resolution"
SLOPE = "encoder: errors over a turn"
WARMER = "scale factor: temperature against that at the lever frequency"
CHORD = "straight line between two frequencies, which the curve is not"
SKEW = "encoder: time to the latch of the pulses"
SKEW_OF_SAMPLES = "encoder: time to the end of the sample"
HALF = "sample: half of its period, taken out"
SHARED_SLOPE = "table.harmonics"
DB_PER_RELATIVE = 20 / np.log(10)
Relative = dict[str, BudgetLine]  # by source, relative to a gain


@dataclass(frozen=True)
class ResponseFindings:
    """Results of one unit: its points, their response, and the arms if it has them.

    `of_scale` are the lines of the stated scale factor in a value of 1 proportional to it. `warmer` is the relative
    uncertainty of the scale factor at each frequency against that at the lever frequency; `averaged_s` is the averaging
    time of samples, 0 for pulses and for instantaneous samples.
    """

    data: RunData
    unit: UnitUnderTest
    steps: Mapping[float, str]
    points: Sequence[SweepPoint]
    found: FrequencyResponse
    arm: LeverArm | None = None
    of_scale: tuple[BudgetLine, ...] = ()
    warmer: Mapping[float, float] = field(default_factory=dict)
    to_lowest: bool = False
    averaged_s: float = 0.0

    @property
    def model_id(self) -> tuple[str, str]:
        """Id of the equation, and serial number of the unit."""
        return self._subject.id("response/model"), self.unit.serial

    @property
    def skew(self) -> float:
        """Standard uncertainty of the time between the latches of encoder and pulses, or the end of the sample."""
        return self._clock.skew_u_s

    def findings(self) -> Iterator[Finding]:
        """Findings: arms, gains, phases, the bandwidth and the phase there."""
        if self.arm is not None:
            yield from self._arms(self.arm)
        for number, point in enumerate(self.found.points):
            at = {"point": number, "frequency_hz": point.frequency_hz}
            step = (self.steps[point.frequency_hz],)
            lines = [line.times(point.gain) for line in self._of_gain(point).values()]
            name = "over that at the lever frequency" if self.arm else "sine of the sensor over that of the table"
            yield self._subject.finding("gain", name, point.gain, "1", lines, at, step, f"@{number}")
            name = "against the table, negative where the sensor lags"
            yield self._subject.finding(
                "phase", name, point.phase_deg, "°", self._of_phase(point), at, step, f"@{number}"
            )
            if (wave := self.found.waveform) is not None and self.arm and wave.frequency_hz == point.frequency_hz:
                scaled = [line.times(wave.gain / point.gain) for line in lines]
                name = "by the two-sample reference"
                only_hz = {"frequency_hz": point.frequency_hz}
                yield self._subject.finding("gain/two_sample", name, wave.gain, "1", scaled, only_hz, step)
        yield from self._bandwidth()

    # Gain and phase

    def _of_gain(self, point: ResponsePoint) -> Relative:
        """Contribution of each source, relative to the gain."""
        own = self._sweep_point(point)
        lines = [
            BudgetLine(self._noise, "A", own.u_output / abs(own.response)),
            BudgetLine(ENCODER, "A", own.swing.u_relative),
        ]
        if self.arm is not None:
            lines += self._relative_to_arm(self.arm, own.swing)
            warmer = self.warmer.get(own.nominal_hz, 0.0)
            lines.append(BudgetLine(WARMER, "B", warmer, None, self._subject.id("scale_per_degree")))
        elif self.to_lowest:
            first = self.points[0]
            lines = [] if own is first else lines
            lines += [] if own is first else [
                BudgetLine("lowest frequency: sensor", "A", first.u_output / abs(first.response), None,
                           self._subject.id("lowest")),
                BudgetLine("lowest frequency: encoder", "A", first.swing.u_relative, None, self._subject.id("lowest")),
            ]  # fmt: skip
        else:
            lines.append(BudgetLine(SLOPE, "B", _slope_u(self._table, own.swing), None, SHARED_SLOPE))
            if not self.unit.is_counted:  # codes depend on no clock, unlike pulses: that of the table's rate remains
                lines.append(self._clock.time_base)
        return {line.source: line for line in lines}

    def _relative_to_arm(self, arm: LeverArm, swing: Swing) -> Iterator[BudgetLine]:
        """Contributions of the arm to a gain relative to that at the lever frequency."""
        y_m = abs(arm.y_m)
        shared = self._subject.id("lever_arm/y")
        yield BudgetLine("lever arm: sensor", "A", arm.u_sensed_m[1] / y_m, None, shared)
        yield BudgetLine("lever arm: encoder", "A", arm.swing.u_relative, None, shared)
        leak_m, bench = self._leak_m(arm.swing), self.data.bench
        for source, name in ((bench.level, "lever arm: level"), (bench.wobble, "lever arm: wobble")):
            yield BudgetLine(name, "B", leak_m * source.u / y_m, None, source.shared)
        yield BudgetLine(SLOPE, "B", _slope_u(self._table, swing, arm.swing), None, SHARED_SLOPE)

    def _of_phase(self, point: ResponsePoint) -> list[BudgetLine]:
        own = self._sweep_point(point)
        return [
            BudgetLine(self._noise, "A", float(np.degrees(own.u_across_output / abs(own.response)))),
            BudgetLine(ENCODER, "A", float(np.degrees(own.swing.u_relative))),
            *self._of_time(own.swing.frequency_hz),
        ]

    def _of_time(self, frequency_hz: float) -> Iterator[BudgetLine]:
        """Contribution of the time between the two latches to a phase."""
        clock, turn_deg = self._clock, 360 * frequency_hz
        name = SKEW if self.unit.is_counted else SKEW_OF_SAMPLES
        yield BudgetLine(name, "B", turn_deg * clock.skew_u_s, None, f"{clock.name}.encoder_skew")
        if self.averaged_s:
            yield clock.time_base.times(turn_deg * self.averaged_s / 2, HALF)

    @property
    def _clock(self) -> ClockRecord:
        return self.data.bench.clock(sent=self.unit.telemetry is not None)

    @property
    def _noise(self) -> str:
        return noise_of(self.unit)

    def _sweep_point(self, point: ResponsePoint) -> SweepPoint:
        return next(own for own in self.points if own.nominal_hz == point.frequency_hz)

    # The bandwidth

    def _bandwidth(self) -> Iterator[Finding]:
        """Frequency at which the gain falls to half the power, and the phase there."""
        found = self.found.bandwidth
        if found.frequency_hz is None or found.phase_deg is None:
            return
        points = self.found.points
        index = next(i for i, each in enumerate(points[1:]) if each.gain < HALF_POWER <= points[i].gain)
        above, below = points[index], points[index + 1]
        log_f = np.log([above.frequency_hz, below.frequency_hz])
        share = float((np.log(found.frequency_hz) - log_f[0]) / (log_f[1] - log_f[0]))
        per_hz = (below.gain_db - above.gain_db) / (log_f[1] - log_f[0]) / found.frequency_hz  # dB
        lines = [line.times(DB_PER_RELATIVE / abs(per_hz)) for line in self._between(above, below, share)]
        bend_db = _bend([each.gain_db for each in points], points, index, found.frequency_hz)
        lines.append(BudgetLine(CHORD, "B", abs(bend_db / per_hz)))
        own_u_hz = float(np.linalg.norm([line.u for line in lines]))
        lines.append(self._clock.time_base.times(found.frequency_hz))
        steps = (self.steps[above.frequency_hz], self.steps[below.frequency_hz])
        bandwidth = self._subject.finding(
            "bandwidth", "where the gain first falls to 1/√2", found.frequency_hz, "Hz", lines, {}, steps
        )
        yield bandwidth
        turn_per_hz = (below.phase_deg - above.phase_deg) / (below.frequency_hz - above.frequency_hz)
        bend_deg = _bend([each.phase_deg for each in points], points, index, found.frequency_hz)
        lines = [
            line.times(180 / np.pi)
            for line in self._between(above, below, share)
            if line.source in (self._noise, ENCODER)
        ]
        lines += [
            *self._of_time(found.frequency_hz),
            BudgetLine("bandwidth", "B", abs(turn_per_hz) * own_u_hz, None, bandwidth.id),  # all points have one clock
            BudgetLine(CHORD, "B", abs(bend_deg)),
        ]
        yield self._subject.finding("phase_at_bandwidth", "phase there", found.phase_deg, "°", lines, {}, steps)

    def _between(self, above: ResponsePoint, below: ResponsePoint, share: float) -> Iterator[BudgetLine]:
        """Contributions of two gains at a share of the way between them; common ones are fully correlated."""
        of_below = self._of_gain(below)
        for source, line in self._of_gain(above).items():
            other = of_below[source].u if source in of_below else line.u
            parts = (1 - share) * line.u, share * other
            u = sum(parts) if line.shared else float(np.hypot(*parts))
            yield BudgetLine(source, line.type, u, line.dof, line.shared)

    # The arms

    def _arms(self, arm: LeverArm) -> Iterator[Finding]:
        """Position of the sensor as determined by itself; a misaligned input axis mixes x and y."""
        bench, swing, step = self.data.bench, arm.swing, tuple(
            step for hz, step in self.steps.items() if np.isclose(hz, arm.swing.frequency_hz, rtol=1e-2)
        )  # fmt: skip
        leak_m = self._leak_m(swing)
        for axis, value_m, squares, level, sensed_m in (
            ("x", arm.x_m, 2, leak_m / 2, arm.u_sensed_m[0]), ("y", arm.y_m, 1, leak_m, arm.u_sensed_m[1]),
        ):  # fmt: skip
            size_m = abs(value_m)
            lines = [
                BudgetLine(self._noise, "A", sensed_m),
                BudgetLine(ENCODER, "A", squares * size_m * swing.u_relative),
                BudgetLine(SLOPE, "B", squares * size_m * _slope_u(self._table, swing), None, SHARED_SLOPE),
                bench.level.times(level, "axis: level"),
                bench.wobble.times(leak_m),
                *(line.times(size_m) for line in self.of_scale),
                bench.gravity(size_m),
                self._clock.time_base.times(size_m if self.unit.is_counted else 2 * size_m),  # the same counts pulses
                BudgetLine("misalignment of the input axis: contained", "alias", 0.0),
            ]
            name = f"{axis} of the sensor from the axis of the table, in the frame of the fixture"
            yield self._subject.finding(f"lever_arm/{axis}", name, value_m, "m", lines, {}, step)

    def _leak_m(self, swing: Swing) -> float:
        """Arm equivalent to gravity for 1 rad of tilt at the frequency of an oscillation: g θ against (2πf)² θ r."""
        return float(self.data.bench.gravity_mps2 / (2 * np.pi * swing.frequency_hz) ** 2)

    @property
    def _table(self) -> AxisRecord:
        return self.data.bench.head

    @property
    def _subject(self) -> Subject:
        return self.data.subject(self.unit)


def _slope_u(table: AxisRecord, swing: Swing, over: Swing | None = None) -> float:
    """Relative effect of encoder errors over a turn on the amplitude of an oscillation, or on a ratio of two.

    Harmonic n of an error is a sine of the angle; an oscillation by ±θ has 2 J1(nθ)/(nθ) of its slope.
    """
    parts = [
        order * u_deg * np.pi / 180 * (_shown(order, swing) - (_shown(order, over) if over is not None else 0.0))
        for order, u_deg in enumerate(table.harmonics_u_deg, start=1)
    ]
    return float(np.linalg.norm(parts))


def _shown(order: int, swing: Swing) -> float:
    reach_rad = order * abs(swing.rate) / (2 * np.pi * swing.frequency_hz) * np.pi / 180
    return float(2 * j1(reach_rad) / reach_rad) if reach_rad else 1.0


def _bend(values: Sequence[float], points: Sequence[ResponsePoint], index: int, at_hz: float) -> float:
    """Difference of a parabola through a third point from the line through two, at a frequency between."""
    third = index + 2 if index + 2 < len(points) else index - 1
    if third < 0:
        return 0.0
    rows = [index, index + 1, third]
    log_f = np.log([points[row].frequency_hz for row in rows]) - np.log(at_hz)
    parabola = np.polyfit(log_f, [values[row] for row in rows], 2)[-1]
    line = np.polyfit(log_f[:2], [values[row] for row in rows[:2]], 1)[-1]
    return float(parabola - line)
