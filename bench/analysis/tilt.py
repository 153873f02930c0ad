"""An accelerometer as a tilt meter, without and with compensation of its bias (methods.md 6.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.analysis.fit import Array


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


def compare_tilt(
    temperature_c: Array, output_v: Array, *, scale_v_per_g: float, nominal_bias_v: float, bias_v: tuple[float, float]
) -> TiltComparison:
    """Tilt = asin((U - K0) / K1) of samples (n,) with K0 nominal, and with K0 = bias_v[0] + bias_v[1] T.

    A sample with something missing is left out, and so is one beyond ±90° in either way; the latter raises the flag
    `out_of_range`.
    """
    present = np.isfinite(temperature_c) & np.isfinite(output_v)
    temperature_c, output_v = temperature_c[present], output_v[present]
    raw = (output_v - nominal_bias_v) / scale_v_per_g
    compensated = (output_v - bias_v[0] - bias_v[1] * temperature_c) / scale_v_per_g
    possible = (np.abs(raw) <= 1) & (np.abs(compensated) <= 1)
    raw_deg, compensated_deg = (np.degrees(np.arcsin(sine[possible])) for sine in (raw, compensated))
    some = bool(possible.any())
    return TiltComparison(
        raw_span_deg=float(np.ptp(raw_deg)) if some else None,
        compensated_span_deg=float(np.ptp(compensated_deg)) if some else None,
        raw_mean_deg=float(np.mean(raw_deg)) if some else None,
        compensated_mean_deg=float(np.mean(compensated_deg)) if some else None,
        flags=() if possible.all() else ("out_of_range",),
        excluded={"missing": int(np.sum(~present)), "out_of_range": int(np.sum(~possible))},
    )
