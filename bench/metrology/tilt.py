"""Accelerometers as tilt meters (equations 6.4): one up to ±90°, two at right angles over the full circle.

Uncertainties are to first order (JCGM 100, 5.1). A misalignment of the input axis on the tilted object adds to the
tilt, and is not included.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.metrology.least_squares import Array
from bench.metrology.results.flag import TOO_FEW_TEMPERATURES
from bench.metrology.temperature_checks import beyond_possible, usable


@dataclass(frozen=True, slots=True)
class TiltComparison:
    """Span (largest - smallest) and mean of the tilt, in degrees, with a constant bias and with the bias model.

    Both are over the same samples; None without any.
    """

    raw_span_deg: float | None
    compensated_span_deg: float | None
    raw_mean_deg: float | None
    compensated_mean_deg: float | None
    flags: tuple[str, ...]
    excluded: dict[str, int]


@dataclass(frozen=True, slots=True)
class TiltModel:
    """Scale factor of an accelerometer, its nominal bias, and constant and slope of its bias over temperature."""

    scale_v_per_g: float
    nominal_bias_v: float
    bias_v: tuple[float, float]


def compare_tilt(
    temperature_c: Array, output_v: Array, *, scale_v_per_g: float, nominal_bias_v: float, bias_v: tuple[float, float]
) -> TiltComparison:
    """Tilt = asin((U - K0) / K1) of samples (n,) with K0 nominal, and with K0 = bias_v[0] + bias_v[1] T.

    Samples with missing values, with an implausible temperature, or beyond ±90° are left out; the last raises the flag
    `out_of_range`. With fewer than two temperatures there is no span: `too_few_temperatures`.
    """
    present = np.isfinite(temperature_c) & np.isfinite(output_v)
    broken = present & beyond_possible(temperature_c)
    usable = present & ~broken
    temperature_c, output_v = temperature_c[usable], output_v[usable]
    raw = (output_v - nominal_bias_v) / scale_v_per_g
    compensated = (output_v - bias_v[0] - bias_v[1] * temperature_c) / scale_v_per_g
    possible = (np.abs(raw) <= 1) & (np.abs(compensated) <= 1)
    raw_deg, compensated_deg = (indicated_deg(sine[possible]) for sine in (raw, compensated))
    some = bool(possible.any())
    return TiltComparison(
        raw_span_deg=float(np.ptp(raw_deg)) if some else None,
        compensated_span_deg=float(np.ptp(compensated_deg)) if some else None,
        raw_mean_deg=float(np.mean(raw_deg)) if some else None,
        compensated_mean_deg=float(np.mean(compensated_deg)) if some else None,
        flags=(
            *(() if possible.all() else ("out_of_range",)),
            *(() if len(np.unique(temperature_c[possible])) > 1 else (TOO_FEW_TEMPERATURES,)),
        ),
        excluded={
            "missing": int(np.sum(~present)),
            "thermometer": int(np.sum(broken)),
            "out_of_range": int(np.sum(~possible)),
        },
    )


@dataclass(frozen=True, slots=True)
class TiltOfTwoComparison:
    """Span and mean of the tilt by two accelerometers, in degrees, with constant biases and with the bias models.

    `u_skew_deg` is the largest contribution of the skew to the compensated tilt. None without a sample of both.
    """

    raw_span_deg: float | None
    compensated_span_deg: float | None
    raw_mean_deg: float | None
    compensated_mean_deg: float | None
    u_skew_deg: float | None


def compare_tilt_of_two(
    temperature_c: Array, outputs_v: tuple[Array, Array], models: tuple[TiltModel, TiltModel], *, skew_rad: float,
    u_skew_rad: float,
) -> TiltOfTwoComparison:  # fmt: skip
    """Tilt of samples (n,) of two accelerometers at 90° and a skew, the second up when the first is level.

    Samples with a missing value or an implausible temperature are left out. Angles are continuous from sample to
    sample, so that a tilt near ±180° has no jump.
    """
    along_v, across_v = outputs_v
    known = usable(temperature_c) & np.isfinite(along_v) & np.isfinite(across_v)
    if not known.any():
        return TiltOfTwoComparison(None, None, None, None, None)
    along, across = (TiltAxis(each.scale_v_per_g, 0.0, 0.0, 0.0, 0.0) for each in models)
    found = []
    for biases_v in (
        [each.nominal_bias_v for each in models],
        [each.bias_v[0] + each.bias_v[1] * temperature_c[known] for each in models],
    ):
        tilt = tilt_of_two(
            along, across, along_v[known] - biases_v[0], across_v[known] - biases_v[1], skew_rad=skew_rad,
            u_skew_rad=u_skew_rad,
        )  # fmt: skip
        found.append((np.unwrap(tilt.tilt_deg, period=360.0), tilt.u_deg))
    (raw_deg, _), (compensated_deg, u_deg) = found
    return TiltOfTwoComparison(
        float(np.ptp(raw_deg)), float(np.ptp(compensated_deg)), float(np.mean(raw_deg)),
        float(np.mean(compensated_deg)), float(np.max(u_deg)),
    )  # fmt: skip


@np.errstate(invalid="ignore")
def indicated_deg(force_g: Array) -> Array:
    """Tilt (n,) indicated by an accelerometer from its specific force; NaN beyond ±90°."""
    return np.asarray(np.degrees(np.arcsin(force_g)))


@dataclass(frozen=True, slots=True)
class TiltAxis:
    """One calibrated accelerometer: its output is `bias_v` + `scale_v_per_g` × specific force in g.

    The others are standard uncertainties, independent of each other and of those of another accelerometer;
    `u_output_v` is that of one sample of the output.
    """

    scale_v_per_g: float
    bias_v: float
    u_scale_v_per_g: float
    u_bias_v: float
    u_output_v: float

    def force_g(self, output_v: Array) -> Array:
        """Specific force along the input axis (n,)."""
        return np.asarray((output_v - self.bias_v) / self.scale_v_per_g)

    def u_force_g(self, output_v: Array) -> Array:
        """Standard uncertainty of the specific force (n,)."""
        from_scale_v = self.force_g(output_v) * self.u_scale_v_per_g
        u_v = np.sqrt(self.u_output_v**2 + self.u_bias_v**2 + from_scale_v**2)
        return np.asarray(u_v / abs(self.scale_v_per_g))


@dataclass(frozen=True, slots=True)
class Tilt:
    """Tilt in degrees and its standard uncertainty, both (n,)."""

    tilt_deg: Array
    u_deg: Array


@np.errstate(divide="ignore", invalid="ignore")
def tilt_of_one(axis: TiltAxis, output_v: Array) -> Tilt:
    """Tilt θ = asin a of one accelerometer, with u(θ) = u(a) / cos θ; NaN beyond ±90°.

    The uncertainty grows towards ±90°, where one axis has little sensitivity; within a few u(a)^½ rad of it, it is too
    large.
    """
    tilt_rad = np.arcsin(axis.force_g(output_v))
    return Tilt(np.degrees(tilt_rad), np.degrees(axis.u_force_g(output_v) / np.cos(tilt_rad)))


@np.errstate(divide="ignore", invalid="ignore")
def tilt_of_two(
    along: TiltAxis, across: TiltAxis, along_v: Array, across_v: Array, *, skew_rad: float = 0.0, u_skew_rad: float
) -> Tilt:
    """Tilt of the input axis `along`, from -180° to 180°, with a second accelerometer `across`.

    `across` is up when `along` is level. Both lie in the plane of the tilt, `across` at 90° + ε from `along`, ε the
    `skew_rad`: they sense a = g sin θ and b = g cos(θ + ε), so that tan θ = a cos ε / (b + a sin ε). The quotient
    depends neither on the size of g nor on a tilt of the plane. The uncertainty follows from the derivatives of a cos(θ
    + ε) = b sin θ.
    """
    a, b = along.force_g(along_v), across.force_g(across_v)
    sine, cosine = a * np.cos(skew_rad), b + a * np.sin(skew_rad)
    tilt_rad, size = np.arctan2(sine, cosine), np.hypot(sine, cosine)
    from_along = np.cos(tilt_rad + skew_rad) / size * along.u_force_g(along_v)
    from_across = np.sin(tilt_rad) / size * across.u_force_g(across_v)
    from_skew = np.sin(tilt_rad) * np.sin(tilt_rad + skew_rad) / np.cos(skew_rad) * u_skew_rad
    u_rad = np.sqrt(from_along**2 + from_across**2 + from_skew**2)
    return Tilt(np.degrees(tilt_rad), np.degrees(u_rad))
