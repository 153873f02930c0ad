"""True constants of the sensors of an inertial unit.

They are defined as the results are: the noiseless channels in all 24 attitudes and at rates about each axis, at the
indicated temperature and with the bias drift of that time.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulators.physics.table_kinematics import earth_dps
from simulators.units.accelerometer import Decoding
from simulators.units.imu_drawn import ImuTruth

Array = NDArray[np.float64]
RATES_DPS = (1.0, -1.0, 3.0, -3.0, 5.0, -5.0)


def accelerometer_constants(
    truth: ImuTruth, axis: int, temperature_c: float, drifted_g: float, decoding: Decoding | None = None
) -> dict[str, float]:
    """True K0 (g, with K2 in it), K1 (pulse/s/g, with K3), K2 (g/g²) and misalignments (rad), as "misalignment x".

    With a decoding K1 is that of the decoded output. They are constants outside the dead band of the converter: pulses
    that it takes away in one attitude are no misalignment.
    """
    up = _attitudes()[:, :, 2]
    ordered = [up[:, (axis + shift) % 3] for shift in range(3)]
    channel, at_c = replace(truth.accelerometers[axis], dead_band_a=0.0), np.full(len(up), temperature_c)
    force_g = (ordered[0], ordered[1], ordered[2])
    output = channel.output(channel.current_a(force_g, at_c, np.full(len(up), drifted_g)), decoding)
    own = up[:, axis]
    k1 = float((output[own > 0.5].mean() - output[own < -0.5].mean()) / 2)
    fitted = _solved(np.column_stack([np.ones(len(up)), up, own**2]), output)
    found = {"K0": float(output[np.abs(own) > 0.5].mean()) / k1, "K1": k1, "K2": fitted[4] / fitted[1 + axis]}
    return found | {f"misalignment {n}": fitted[1 + i] / fitted[1 + axis] for i, n in enumerate("xyz") if i != axis}


def gyro_constants(
    truth: ImuTruth, axis: int, latitude_deg: float, temperature_c: float, drifted_dps: float,
    decoding: Decoding | None = None,
) -> dict[str, float]:  # fmt: skip
    """True D0 (°/s), KG (pulse/°), g-sensitivities (°/s/g) and misalignments (rad), by axis.

    With a decoding KG is that of the decoded output, in its unit per °/s.
    """
    attitudes, local_dps = _attitudes(), earth_dps(latitude_deg)
    force_g, rate_dps = attitudes[:, :, 2], attitudes @ local_dps

    def output(rate: Array, force: Array) -> Array:
        rates, forces = (tuple(each[:, (axis + shift) % 3] for shift in range(3)) for each in (rate, force))
        drifted = np.full(len(rate), drifted_dps)
        pps = truth.gyros[axis].output_pps(rates, forces, temperature_c, drifted)  # type: ignore[arg-type]  # threes
        return pps if decoding is None else truth.gyros_send[axis].codes(pps) * decoding.scale + decoding.offset

    at_rest = output(rate_dps, force_g)
    slopes = [_slope(output, about, local_dps[2]) for about in range(3)]
    kg, vertical = slopes[axis], np.abs(force_g[:, axis]) > 0.5
    fitted = _solved(np.column_stack([np.ones(len(force_g)), force_g, rate_dps]), at_rest)
    found = {"D0": float(at_rest[vertical].mean()) / kg, "KG": kg}
    found |= {f"g_sensitivity {name}": fitted[1 + i] / kg for i, name in enumerate("xyz")}
    return found | {f"gyro_misalignment {name}": slopes[i] / kg for i, name in enumerate("xyz") if i != axis}


def _slope(output: Any, about: int, earth_up_dps: float) -> float:
    """Slope of the output over the rate about an axis that points up."""
    turned = np.zeros((len(RATES_DPS), 3))
    turned[:, about] = np.array(RATES_DPS)
    up = np.zeros_like(turned)
    up[:, about] = 1.0
    return _solved(np.column_stack([np.ones(len(turned)), RATES_DPS]), output(turned + up * earth_up_dps, up))[1]


def _solved(design: Array, values: Array) -> list[float]:
    solution: list[float] = np.linalg.lstsq(design, values, rcond=None)[0].tolist()
    return solution


def _attitudes() -> Array:
    """Rotations of a cube: rows are the axes of the unit in east, north and up, (24, 3, 3)."""
    found = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            rows = np.eye(3)[list(order)] * np.array(signs)[:, np.newaxis]
            if np.linalg.det(rows) > 0:
                found.append(rows)
    return np.array(found)
