"""The unit under test: specific force and temperature in, current and pulses out (equations 8.4 and 8.5)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from simulators.physics.dynamics import Dynamics
from simulators.physics.noise import Noise
from simulators.units.drawn import At, drawn
from simulators.units.unit_file import Polynomial, UnitFile, stream

Array = NDArray[np.float64]
Counts = NDArray[np.int64]
_CONVERTER_REFERENCE_C = 25.0


@dataclass(frozen=True, slots=True)
class Decoding:
    """Decoding of a unit's codes: scale times code, plus offset."""

    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class Sent:
    """Codes of a channel: relative error of the clock, zero, and noise of a sample in codes."""

    clock: float
    zero_code: float
    noise_code: float


Through = float | Decoding | None
"""Signal path of a unit's current: a load in Ω, its own A/D converter, or the pulse converter."""


@dataclass(frozen=True, slots=True)
class UnitTruth:
    """One unit as drawn for one run, in g, A, °C, s, rad, pulse/s."""

    reference_c: Annotated[float, At("accelerometer.reference_temperature")]
    bias: Annotated[Polynomial, At("accelerometer.K0")]
    scale_a_per_g: Annotated[float, At("accelerometer.K1.at_reference")]
    scale: Annotated[Polynomial, At("accelerometer.K1")]  # relative, its first term 1
    k2: Annotated[float, At("accelerometer.K2")]
    k3: Annotated[float, At("accelerometer.K3")]
    kip: Annotated[float, At("accelerometer.Kip")]
    kio: Annotated[float, At("accelerometer.Kio")]
    misalignment_o: Annotated[float, At("accelerometer.misalignment_o")]
    misalignment_p: Annotated[float, At("accelerometer.misalignment_p")]
    kd: Annotated[float, At("accelerometer.Kd")]
    hysteresis_g: Annotated[float, At("accelerometer.hysteresis.amplitude")]
    thresholds_c: Annotated[tuple[float, ...], At("accelerometer.hysteresis.thresholds")]
    drift_g_per_s: Annotated[float, At("accelerometer.drift")]
    warm_up_g: Annotated[float, At("accelerometer.warm_up.amplitude")]
    warm_up_s: Annotated[float, At("accelerometer.warm_up.time_constant")]
    noise_density: Annotated[float, At("accelerometer.noise.density")]
    instability_g: Annotated[float, At("accelerometer.noise.instability")]
    range_g: Annotated[float, At("accelerometer.range")]
    pulses_per_a: Annotated[float, At("converter.S")]
    alpha: Annotated[float, At("converter.alpha")]
    asymmetry: Annotated[float, At("converter.asymmetry")]
    nonlinearity: Annotated[float, At("converter.nonlinearity")]
    full_scale_a: Annotated[float, At("converter.full_scale")]
    zero_pps: Annotated[float, At("converter.zero")]
    zero_drift_pps: Annotated[float, At("converter.zero_drift")]
    dead_band_a: Annotated[float, At("converter.dead_band")]
    max_rate_pps: Annotated[float, At("converter.max_rate")]
    counter_bits: Annotated[int, At("converter.counter_bits")]
    converter_c: Annotated[float, At("converter.temperature")]
    supply_a: Annotated[float, At("supply.current")]
    turn_on_g: Annotated[float, At("accelerometer.turn_on")] = 0.0  # standard deviation of the step at each power-on
    turn_on_scale: Annotated[float, At("accelerometer.turn_on_scale")] = 0.0  # the same of the scale factor, relative
    jumps: tuple[tuple[float, float], ...] = ()  # the temperature in °C and the size in g of each
    alpha2: Annotated[float, At("converter.alpha2")] = 0.0
    bandwidth_hz: Annotated[float, At("accelerometer.bandwidth")] = 300.0
    damping: Annotated[float | None, At("accelerometer.damping")] = None
    delay_s: Annotated[float, At("accelerometer.delay")] = 0.0
    codes_per_a: Annotated[float, At("telemetry.S")] = 0.0  # for a unit that sends none
    zero_code: Annotated[float, At("telemetry.zero")] = 0.0
    noise_code: Annotated[float, At("telemetry.noise")] = 0.0
    code_bits: Annotated[int, At("telemetry.bits")] = 24
    clock: Annotated[float, At("telemetry.clock")] = 0.0
    code_alpha: Annotated[float, At("telemetry.alpha")] = 0.0
    code_alpha2: Annotated[float, At("telemetry.alpha2")] = 0.0
    zero_drift_code: Annotated[float, At("telemetry.zero_drift")] = 0.0
    resistor_alpha: Annotated[float, At("resistor.alpha")] = 0.0
    resistor_alpha2: Annotated[float, At("resistor.alpha2")] = 0.0
    zero_v: Annotated[float, At("resistor.zero")] = 0.0
    zero_drift_v: Annotated[float, At("resistor.zero_drift")] = 0.0
    input_hysteresis_g: Annotated[float, At("accelerometer.input_hysteresis.amplitude")] = 0.0
    input_thresholds_g: Annotated[tuple[float, ...], At("accelerometer.input_hysteresis.thresholds")] = ()

    @property
    def dynamics(self) -> Dynamics | None:
        """Dynamic response; None if instantaneous."""
        return None if self.damping is None else Dynamics(self.bandwidth_hz, self.damping, self.delay_s)

    def current_a(self, force_g: tuple[Array, Array, Array], temperature_c: Array, extra_bias_g: Array) -> Array:
        """Output of the accelerometer; `force_g` along input, pendulous and output axes, `extra_bias_g` is drift."""
        _, a_p, a_o = force_g
        t = temperature_c - self.reference_c
        a = self.sensed_g(force_g)
        shape = a * (1 + a * (self.k2 + a * self.k3) + self.kip * a_p + self.kio * a_o)
        scale = self.scale_a_per_g * _horner(self.scale, t)
        return np.asarray(scale * (_horner(self.bias, t) + extra_bias_g + shape))

    def sensed_g(self, force_g: tuple[Array, Array, Array]) -> Array:
        """Specific force along the misaligned input axis, limited to the range."""
        a_i, a_p, a_o = force_g
        return np.clip(a_i + self.misalignment_o * a_p - self.misalignment_p * a_o, -self.range_g, self.range_g)

    def output(self, current_a: Array, through: Through, converter_c: Array | None = None) -> Array:
        """Measured output: volts across a load, decoded codes, or the converter's rate in pulse/s.

        Without a temperature the load or converter is at the reference temperature of the unit file.
        """
        if isinstance(through, Decoding):
            return self.codes(current_a, converter_c) * through.scale + through.offset
        if through is None:
            return self.rate_pps(current_a, converter_c)
        return self.volts(current_a, through, converter_c)

    def volts(self, current_a: Array, load_ohm: float, converter_c: Array | None = None) -> Array:
        """Voltage of the current across a load."""
        warm = self._warm_c(converter_c)
        scale = load_ohm * (1 + self.resistor_alpha * warm + self.resistor_alpha2 * warm**2)
        return np.asarray(scale * current_a + self.zero_v + self.zero_drift_v * warm)

    def codes(self, current_a: Array, converter_c: Array | None = None) -> Array:
        """Codes of its A/D converter for a current, without noise and before rounding."""
        warm = self._warm_c(converter_c)
        scale = self.codes_per_a * (1 + self.code_alpha * warm + self.code_alpha2 * warm**2)
        return coded(scale * current_a + self.zero_code + self.zero_drift_code * warm, self.code_bits)

    def _warm_c(self, converter_c: Array | None) -> Array | float:
        """Difference of the converter's temperature from its reference temperature."""
        return (self.converter_c if converter_c is None else converter_c) - _CONVERTER_REFERENCE_C

    def rate_pps(self, current_a: Array, converter_c: Array | None = None) -> Array:
        """Net pulse rate of the converter; 0 inside the dead band. Without a temperature at the reference one."""
        warm = self._warm_c(converter_c)
        scale = self.pulses_per_a * (1 + warm * (self.alpha + warm * self.alpha2))
        rate = scale * (1 + np.sign(current_a) * (self.asymmetry / 2))
        rate += (self.nonlinearity * self.pulses_per_a / self.full_scale_a) * np.abs(current_a)
        rate *= current_a
        rate += self.zero_pps + self.zero_drift_pps * warm
        rate[np.abs(rate) < self.pulses_per_a * self.dead_band_a] = 0.0
        return rate.clip(-self.max_rate_pps, self.max_rate_pps)


def coded(codes: Array, bits: int) -> Array:
    """Codes limited to the range of a number of bits."""
    largest = 2.0 ** (bits - 1)
    return np.clip(codes, -largest, largest - 1)


def draw_unit(unit: UnitFile, seed: int, place: str) -> UnitTruth:
    """Draw the unit of one run."""
    jumps = tuple(
        (jump.at, jump.size.value(stream(seed, "uut", place, "accelerometer", "jumps", str(number))))
        for number, jump in enumerate(unit.accelerometer.jumps)
    )
    found = drawn(UnitTruth, unit, seed, place, jumps=jumps)
    return replace(found, scale=(1.0, *found.scale[1:]))


def noise_of(truth: UnitTruth, seed: int, place: str) -> Noise:
    """Noise of an accelerometer, in g."""
    streams = stream(seed, "noise", place, "white"), stream(seed, "noise", place, "instability")
    return Noise(truth.noise_density * math.sqrt(0.5), truth.instability_g, streams)


class Hysteresis:
    """Play operators on the sensor's temperature with their effect on the bias, and bias jumps."""

    def __init__(self, truth: UnitTruth, start_c: float) -> None:
        self._thresholds = truth.thresholds_c
        self._gain = truth.hysteresis_g / math.fsum(truth.thresholds_c) if truth.thresholds_c else 0.0
        self._play = [start_c] * len(truth.thresholds_c)
        self._to_come, self._jumped_g, self._last_c = list(truth.jumps), 0.0, start_c

    def bias_g(self, temperature_c: float) -> float:
        """Bias after the temperature has reached `temperature_c`."""
        return self.follow([temperature_c])[0]

    def follow(self, course_c: Sequence[float]) -> list[float]:
        """Bias after each of the consecutive temperatures."""
        lags_c = [self._lags_c(number, course_c) for number in range(len(self._thresholds))]
        sums_c = map(math.fsum, zip(*lags_c, strict=True)) if lags_c else repeat(0.0)
        jumped_g = [self._after_jumps_g(each_c) for each_c in course_c] if self._to_come else repeat(self._jumped_g)
        return [self._gain * sum_c + jump_g for sum_c, jump_g, _ in zip(sums_c, jumped_g, course_c, strict=False)]

    def _lags_c(self, number: int, course_c: Sequence[float]) -> list[float]:
        """Difference of each temperature from the play operator of one threshold after it."""
        threshold_c, play_c, lags_c = self._thresholds[number], self._play[number], []
        for each_c in course_c:
            if play_c < each_c - threshold_c:
                play_c = each_c - threshold_c
            elif play_c > each_c + threshold_c:
                play_c = each_c + threshold_c
            lags_c.append(each_c - play_c)
        self._play[number] = play_c
        return lags_c

    def _after_jumps_g(self, temperature_c: float) -> float:
        """Sum of the jumps whose temperatures have been passed in a rise."""
        passed = [jump for jump in self._to_come if self._last_c < jump[0] <= temperature_c]
        self._to_come = [jump for jump in self._to_come if jump not in passed]
        self._jumped_g += math.fsum(size_g for _, size_g in passed)
        self._last_c = temperature_c
        return self._jumped_g


def _horner(coefficients: Polynomial, t: Array) -> Array:
    c0, c1, c2, c3, c4 = coefficients
    return c0 + t * (c1 + t * (c2 + t * (c3 + t * c4)))
