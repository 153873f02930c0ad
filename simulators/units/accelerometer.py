"""The unit under test: specific force and temperature in, current and pulses out (equations 8.4 and 8.5)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulators.physics.dynamics import Dynamics
from simulators.physics.noise import Noise
from simulators.units.unit_file import Draw, Polynomial, UnitFile, stream

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

    reference_c: float
    bias: Polynomial
    scale_a_per_g: float
    scale: Polynomial  # relative, its first term 1
    k2: float
    k3: float
    kip: float
    kio: float
    misalignment_o: float
    misalignment_p: float
    kd: float
    hysteresis_g: float
    thresholds_c: tuple[float, ...]
    drift_g_per_s: float
    warm_up_g: float
    warm_up_s: float
    noise_density: float
    instability_g: float
    range_g: float
    pulses_per_a: float
    alpha: float
    asymmetry: float
    nonlinearity: float
    full_scale_a: float
    zero_pps: float
    zero_drift_pps: float
    dead_band_a: float
    max_rate_pps: float
    counter_bits: int
    converter_c: float
    supply_a: float
    turn_on_g: float = 0.0  # standard deviation of the bias step at each power-on
    turn_on_scale: float = 0.0  # the same of the relative step of the scale factor
    jumps: tuple[tuple[float, float], ...] = ()  # the temperature in °C and the size in g of each
    alpha2: float = 0.0
    bandwidth_hz: float = 300.0
    damping: float | None = None
    delay_s: float = 0.0
    codes_per_a: float = 0.0  # for a unit that sends none
    zero_code: float = 0.0
    noise_code: float = 0.0
    code_bits: int = 24
    clock: float = 0.0
    code_alpha: float = 0.0
    code_alpha2: float = 0.0
    zero_drift_code: float = 0.0
    resistor_alpha: float = 0.0
    resistor_alpha2: float = 0.0
    zero_v: float = 0.0
    zero_drift_v: float = 0.0
    input_hysteresis_g: float = 0.0
    input_thresholds_g: tuple[float, ...] = ()

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
        scale = self.pulses_per_a * (1 + self.alpha * warm + self.alpha2 * warm**2)
        slope = scale * (1 + np.sign(current_a) * self.asymmetry / 2)
        bent = self.nonlinearity * self.pulses_per_a * current_a * np.abs(current_a) / self.full_scale_a
        rate = slope * current_a + self.zero_pps + self.zero_drift_pps * warm + bent
        rate = np.where(np.abs(rate) < self.pulses_per_a * self.dead_band_a, 0.0, rate)
        return np.clip(rate, -self.max_rate_pps, self.max_rate_pps)


def coded(codes: Array, bits: int) -> Array:
    """Codes limited to the range of a number of bits."""
    largest = 2.0 ** (bits - 1)
    return np.clip(codes, -largest, largest - 1)


def draw_unit(unit: UnitFile, seed: int, place: str) -> UnitTruth:
    """Draw the unit of one run: every `{mean, sd}` from its own stream."""
    a, c, t, r = unit.accelerometer, unit.converter, unit.telemetry, unit.resistor

    def value(draw: Draw, *path: str) -> float:
        return draw.value(stream(seed, "uut", place, *path))

    def polynomial(model: str, *names: str) -> Polynomial:
        block = getattr(a, model)
        low = [value(getattr(block, name), "accelerometer", model, name) for name in names]
        return (low[0], low[1], low[2], low[3], low[4])

    orders = ("at_reference", "linear", "quadratic", "cubic", "quartic")
    scale = polynomial("K1", *orders)
    return UnitTruth(
        reference_c=a.reference_temperature,
        bias=polynomial("K0", *orders),
        scale_a_per_g=scale[0],
        scale=(1.0, *scale[1:]),
        k2=value(a.K2, "accelerometer", "K2"),
        k3=value(a.K3, "accelerometer", "K3"),
        kip=value(a.Kip, "accelerometer", "Kip"),
        kio=value(a.Kio, "accelerometer", "Kio"),
        misalignment_o=value(a.misalignment_o, "accelerometer", "misalignment_o"),
        misalignment_p=value(a.misalignment_p, "accelerometer", "misalignment_p"),
        kd=value(a.Kd, "accelerometer", "Kd"),
        hysteresis_g=value(a.hysteresis.amplitude, "accelerometer", "hysteresis", "amplitude"),
        thresholds_c=a.hysteresis.thresholds,
        drift_g_per_s=value(a.drift, "accelerometer", "drift"),
        warm_up_g=value(a.warm_up.amplitude, "accelerometer", "warm_up", "amplitude"),
        warm_up_s=a.warm_up.time_constant,
        noise_density=value(a.noise.density, "accelerometer", "noise", "density"),
        instability_g=value(a.noise.instability, "accelerometer", "noise", "instability"),
        range_g=a.range,
        pulses_per_a=value(c.S, "converter", "S"),
        alpha=value(c.alpha, "converter", "alpha"),
        alpha2=value(c.alpha2, "converter", "alpha2"),
        asymmetry=value(c.asymmetry, "converter", "asymmetry"),
        nonlinearity=value(c.nonlinearity, "converter", "nonlinearity"),
        full_scale_a=c.full_scale,
        zero_pps=value(c.zero, "converter", "zero"),
        zero_drift_pps=value(c.zero_drift, "converter", "zero_drift"),
        dead_band_a=value(c.dead_band, "converter", "dead_band"),
        max_rate_pps=c.max_rate,
        counter_bits=c.counter_bits,
        converter_c=c.temperature,
        supply_a=unit.supply.current,
        turn_on_g=value(a.turn_on, "accelerometer", "turn_on"),
        turn_on_scale=value(a.turn_on_scale, "accelerometer", "turn_on_scale"),
        jumps=tuple(
            (jump.at, value(jump.size, "accelerometer", "jumps", str(number))) for number, jump in enumerate(a.jumps)
        ),
        bandwidth_hz=a.bandwidth,
        damping=a.damping,
        delay_s=a.delay,
        codes_per_a=value(t.S, "telemetry", "S") if t is not None else 0.0,
        zero_code=value(t.zero, "telemetry", "zero") if t is not None else 0.0,
        noise_code=value(t.noise, "telemetry", "noise") if t is not None else 0.0,
        code_bits=t.bits if t is not None else 24,
        clock=value(t.clock, "telemetry", "clock") if t is not None else 0.0,
        code_alpha=value(t.alpha, "telemetry", "alpha") if t is not None else 0.0,
        code_alpha2=value(t.alpha2, "telemetry", "alpha2") if t is not None else 0.0,
        zero_drift_code=value(t.zero_drift, "telemetry", "zero_drift") if t is not None else 0.0,
        resistor_alpha=value(r.alpha, "resistor", "alpha"),
        resistor_alpha2=value(r.alpha2, "resistor", "alpha2"),
        zero_v=value(r.zero, "resistor", "zero"),
        zero_drift_v=value(r.zero_drift, "resistor", "zero_drift"),
        input_hysteresis_g=value(a.input_hysteresis.amplitude, "accelerometer", "input_hysteresis", "amplitude"),
        input_thresholds_g=a.input_hysteresis.thresholds,
    )


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
        self._play = [
            max(temperature_c - r, min(temperature_c + r, y)) for r, y in zip(self._thresholds, self._play, strict=True)
        ]
        return self._gain * math.fsum(temperature_c - y for y in self._play) + self._after_jumps_g(temperature_c)

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
