"""A gyro: turning, specific force and temperature in, pulses out (equations 8.6).

    W = KG(T) (1 + asymmetry sign w + q3 w²) (w + D0(T) + g-sensitivity · f + noise),   w along the input axis

then a second-order low-pass filter with a delay, the limits of its range, and pulses. This physics is independent of
the world and of the file of one gyro: inertial units use it as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from drivers.schema.fields import Celsius, Hertz, InUnit, Seconds, StrictModel
from drivers.schema.wording import telling
from simulators.physics.dynamics import Dynamics
from simulators.physics.noise import Noise
from simulators.units.drawn import At, drawn
from simulators.units.unit_file import Draw, DrawIn, Ratio, stream

Array = NDArray[np.float64]
Vectors = tuple[Array, Array, Array]
"""Components along the input, the pendulous and the output axis of the place, each (n,)."""


class GyroScaleModel(StrictModel):
    """KG at the reference temperature, and its relative slope."""

    at_reference: Annotated[Draw, DrawIn("pulse/°")]
    linear: Annotated[Draw, DrawIn("1/°C")] = Draw(0)


class GyroBiasModel(StrictModel):
    """D0 at the reference temperature, and its slope."""

    at_reference: Annotated[Draw, DrawIn("°/s")] = Draw(0)
    linear: Annotated[Draw, DrawIn("°/s/°C")] = Draw(0)


class GyroForceModel(StrictModel):
    """Rate error per specific force along each axis."""

    input: Annotated[Draw, DrawIn("°/s/g")] = Draw(0)
    pendulous: Annotated[Draw, DrawIn("°/s/g")] = Draw(0)
    output: Annotated[Draw, DrawIn("°/s/g")] = Draw(0)


class GyroNoiseModel(StrictModel):
    """Angle random walk, and slow bias drift of the given standard deviation."""

    random_walk: Annotated[Draw, DrawIn("°/s^0.5")] = Draw(0)
    instability: Annotated[Draw, DrawIn("°/s")] = Draw(0)


class GyroModel(StrictModel):
    """The gyro of equations 8.6; bandwidth and damping go together, without them it is instantaneous."""

    range: Annotated[float, InUnit("°/s", above=0)] = 400.0
    reference_temperature: Celsius = 20.0
    KG: GyroScaleModel
    D0: GyroBiasModel = GyroBiasModel()
    asymmetry: Ratio = Draw(0)
    q3: Annotated[Draw, DrawIn("s²/°²")] = Draw(0)
    g_sensitivity: GyroForceModel = GyroForceModel()
    misalignment_o: Annotated[Draw, DrawIn("rad")] = Draw(0)
    misalignment_p: Annotated[Draw, DrawIn("rad")] = Draw(0)
    noise: GyroNoiseModel = GyroNoiseModel()
    bandwidth: Hertz | None = None
    damping: Annotated[float, InUnit("", above=0, at_most=0.99)] | None = None
    delay: Seconds = 0.0
    counter_bits: Annotated[int, Field(ge=8, le=64)] = 24

    @model_validator(mode="after")
    def _both_or_none(self) -> Self:
        if (self.bandwidth is None) != (self.damping is None):
            raise telling("bandwidth and damping go together")
        return self


@dataclass(frozen=True, slots=True)
class GyroTruth:
    """One gyro as drawn for one run, in °, s, g, °C, rad and pulses."""

    reference_c: Annotated[float, At("reference_temperature")]
    scale_ppd: Annotated[float, At("KG.at_reference")]
    scale_per_c: Annotated[float, At("KG.linear")]
    bias_dps: Annotated[float, At("D0.at_reference")]
    bias_dps_per_c: Annotated[float, At("D0.linear")]
    asymmetry: Annotated[float, At("asymmetry")]
    q3_s2_per_deg2: Annotated[float, At("q3")]
    force_dps_per_g: Annotated[tuple[float, float, float], At("g_sensitivity")]  # along input, pendulous, output axis
    misalignment_o: Annotated[float, At("misalignment_o")]
    misalignment_p: Annotated[float, At("misalignment_p")]
    random_walk: Annotated[float, At("noise.random_walk")]  # °/√s
    instability_dps: Annotated[float, At("noise.instability")]
    range_dps: Annotated[float, At("range")]
    bandwidth_hz: Annotated[float | None, At("bandwidth")]
    damping: Annotated[float | None, At("damping")]
    delay_s: Annotated[float, At("delay")]
    counter_bits: Annotated[int, At("counter_bits")]
    supply_a: float = 0.0
    codes_per_pps: float = 0.0  # for a gyro that sends none
    zero_code: float = 0.0
    noise_code: float = 0.0
    code_bits: int = 24
    clock: float = 0.0
    amperes_per_pps: float = 0.0  # for a gyro without an analogue output
    zero_a: float = 0.0

    @property
    def dynamics(self) -> Dynamics | None:
        """Dynamic response; None if instantaneous."""
        if self.bandwidth_hz is None or self.damping is None:
            return None
        return Dynamics(self.bandwidth_hz, self.damping, self.delay_s)

    def input_dps(self, rate_dps: Vectors) -> Array:
        """Rate along the input axis, which deviates from that of the place by two small angles."""
        along, pendulous, output = rate_dps
        return along + self.misalignment_o * pendulous - self.misalignment_p * output

    def output_pps(self, rate_dps: Vectors, force_g: Vectors, temperature_c: Array | float, noise_dps: Array) -> Array:
        """Pulse rate for the sensed input, before dynamics and range limits."""
        t = np.asarray(temperature_c) - self.reference_c
        w = self.input_dps(rate_dps)
        bent = 1 + self.asymmetry * np.sign(w) + self.q3_s2_per_deg2 * w**2
        by_force_dps = sum(each * force for each, force in zip(self.force_dps_per_g, force_g, strict=True))
        sensed_dps = w + self.bias_dps + self.bias_dps_per_c * t + by_force_dps + noise_dps
        return np.asarray(self.scale_ppd * (1 + self.scale_per_c * t) * bent * sensed_dps)

    def codes(self, rate_pps: Array) -> Array:
        """Codes of its electronics for a pulse rate, without noise and before rounding."""
        largest = 2.0 ** (self.code_bits - 1)
        return np.clip(self.codes_per_pps * rate_pps + self.zero_code, -largest, largest - 1)

    def current_a(self, rate_pps: Array) -> Array:
        """Current of its analogue output."""
        return self.amperes_per_pps * rate_pps + self.zero_a

    def clipped_pps(self, rate_pps: Array) -> Array:
        """Pulse rate limited to its range, which is that of its scale at the reference temperature."""
        most = abs(self.scale_ppd) * self.range_dps
        return np.clip(rate_pps, -most, most)


def draw_gyro(gyro: GyroModel, seed: int, *path: str, supply_a: float = 0.0) -> GyroTruth:
    """Draw the gyro of one run; `path` names it: the place, and in an inertial unit its axis."""
    return drawn(GyroTruth, gyro, seed, *path, "gyro", supply_a=supply_a)


def noise_of_gyro(truth: GyroTruth, seed: int, *path: str) -> Noise:
    """Angle random walk and slow bias drift, in °/s."""
    streams = stream(seed, "noise", *path, "random walk"), stream(seed, "noise", *path, "instability")
    return Noise(truth.random_walk, truth.instability_dps, streams)
