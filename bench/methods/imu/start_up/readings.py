"""The readings of an inertial unit after a power-on, compensated by its released calibration.

The output is converted at the temperature of the unit's own thermometers, as by a user of the unit. Time counts from
power-on, not from the first reading.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bench.methods.imu.reduction.attitudes import SPECIFIC_FORCE_G, block, earth_rate_dps
from bench.methods.imu.reduction.windows import Visit
from bench.metrology.acquisition import Acquisition
from bench.metrology.bench_uncertainty import BenchRecord
from bench.metrology.least_squares import Array
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import AXES, ReleasedCalibration, UnitUnderTest
from bench.metrology.sampled_codes import quantisation_by_level

HARMLESS = frozenset({"dead_band"})  # for a gyro at rest, which may give no pulse for long


class Readings:
    """Compensated readings of one channel, (n,): times, values and inputs, in the unit of the measured quantity.

    `quantisation_u` is the quantisation uncertainty of each, `alone` the single-reading uncertainty.
    """

    def __init__(self, rows: Sequence[tuple[float, ...]], windows: Sequence[Acquisition]) -> None:
        columns = np.array(rows, np.float64).reshape(-1, 5).T
        self.at_s, self.values, self.drive, alone, self.quantisation_u = columns
        self.alone = float(np.median(alone)) if rows else 0.0
        self.windows = tuple(windows)

    def hidden(self, weights: Array) -> Array:
        """Quantisation uncertainty (m,) of results with sensitivities `weights` (m, n), one error for each input."""
        return np.array(
            [float(np.linalg.norm(quantisation_by_level(gain, self.quantisation_u, self.drive))) for gain in weights]
        )


class PowerOn:
    """Readings of a unit after one power-on; `flags` name unusable ones with the reason.

    `between_s` are the bench times between which it was switched on; None if the run does not record it.
    """

    def __init__(self, visit: Visit, unit: UnitUnderTest, released: ReleasedCalibration, bench: BenchRecord) -> None:
        self.visit = visit
        self._unit, self._released, self._bench = unit, released, bench
        self.flags = [Flag("no_attitude", at=step) for step in visit.unplaced]
        times = (each.acquisition.on_since_s.get(unit.supply) for each in visit.at_rest)
        self.between_s = next(filter(None, times), None)
        if self.between_s is None:
            self.flags.append(Flag("no_power_on", at=visit.path))

    def accelerometer(self, axis: int) -> Readings:
        """Accelerometer readings with the axis vertical; the input is gravity in the g of the calibration."""
        known_mps2 = self._released.gravity_mps2
        ratio = 1.0 if math.isnan(known_mps2) else self._bench.gravity_mps2 / known_mps2
        own = self._vertical(axis)
        drive = [float(SPECIFIC_FORCE_G[attitude, axis]) * ratio for attitude, _ in own]
        return self._readings(f"acc_{AXES[axis]}", [window for _, window in own], drive)

    def gyro_at_rest(self, axis: int) -> Readings:
        """Gyro readings in these attitudes, less the earth rate; the input is specific force, for its g-sensitivity."""
        own = self._vertical(axis)
        earth_dps = earth_rate_dps(self._bench.latitude_deg)
        drive = [float(SPECIFIC_FORCE_G[attitude, axis]) for attitude, _ in own]
        seen_dps = [float(earth_dps[attitude, axis]) for attitude, _ in own]
        return self._readings(f"gyro_{AXES[axis]}", [window for _, window in own], drive, seen_dps)

    def gyro_turned(self, axis: int) -> Readings:
        """Gyro readings during rotation; the input is the rate of the table."""
        turned = self.visit.turned(axis)
        drive = [each.rate_dps for each in turned]
        return self._readings(f"gyro_{AXES[axis]}", [each.acquisition for each in turned], drive)

    def _vertical(self, axis: int) -> list[tuple[int, Acquisition]]:
        own = range(block(axis).start, block(axis).stop)
        return [(each.attitude, each.acquisition) for each in self.visit.at_rest if each.attitude in own]

    def _readings(
        self, channel: str, windows: Sequence[Acquisition], drive: Sequence[float], less: Sequence[float] = ()
    ) -> Readings:
        """Readings of the windows by the released calibration, without unusable ones."""
        rows, kept = [], []
        for window, driven, subtracted in zip(windows, drive, less or [0.0] * len(windows), strict=True):
            value, alone, quantisation_u = self._value(channel, window)
            at_s = self._since_s(window)
            if not math.isnan(value + driven + at_s):
                rows.append((at_s, value - subtracted, driven, alone, quantisation_u))
                kept.append(window)
        return Readings(rows, kept)

    def _since_s(self, window: Acquisition) -> float:
        """Time from power-on to the middle of a window."""
        if self.between_s is None:
            return math.nan
        return (window.begin_s + window.end_s) / 2 - math.fsum(self.between_s) / 2

    def _value(self, channel: str, window: Acquisition) -> tuple[float, float, float]:
        """Value of a channel in a window, with `alone` and `quantisation_u`; NaN if undetermined."""
        read = window.windows[self._unit.channels[channel]]
        of_gyro = channel.startswith("gyro")
        problems = set(read.problems) - (HARMLESS if of_gyro else frozenset())
        read_c = window.temperatures_c.get(self._unit.thermometer(channel))
        at_c = np.nanmean(read_c) if read_c is not None and np.isfinite(read_c).any() else math.nan
        if problems or math.isnan(at_c):
            self.flags += [Flag(problem, at=window.step) for problem in sorted(problems) or ["no_temperature"]]
            return math.nan, math.nan, math.nan
        value, beside = self._compensated(channel, read.mean, read.single_u, float(at_c))
        if math.isnan(value):
            self.flags.append(Flag("beyond_calibration", at=window.step))
        _, hidden = self._compensated(channel, read.mean, read.quantisation_u, float(at_c))
        return value, abs(beside - value), abs(hidden - value)

    def _compensated(self, channel: str, output: float, step: float, at_c: float) -> Array:
        """Compensated value of a mean output, and of that plus a step."""
        outputs, at_both_c = np.array([output, output + step]), np.full(2, at_c)
        values, _ = self._released.channels[channel].apply(outputs, at_both_c, "reject")
        return values
