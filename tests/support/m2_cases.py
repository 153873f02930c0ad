"""Cases of method M2 made from a known inertial unit: records, settings, and the truth behind them.

What gravity and earth rate do in the 24 attitudes is typed here from the table of equations 4.2, its columns f/g and
wx wy wz; the reduction makes them from its directions of x, y and z.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rows = list[dict[str, Any]]

# s is the sine of the latitude, c its cosine.
PRINTED = {
    "Ax1": "+ 0 0 | s 0 c", "Ax2": "+ 0 0 | s c 0", "Ax3": "+ 0 0 | s 0 -c", "Ax4": "+ 0 0 | s -c 0",
    "Ax5": "- 0 0 | -s c 0", "Ax6": "- 0 0 | -s 0 c", "Ax7": "- 0 0 | -s -c 0", "Ax8": "- 0 0 | -s 0 -c",
    "Ay1": "0 + 0 | 0 s -c", "Ay2": "0 + 0 | -c s 0", "Ay3": "0 + 0 | 0 s c", "Ay4": "0 + 0 | c s 0",
    "Ay5": "0 - 0 | c -s 0", "Ay6": "0 - 0 | 0 -s c", "Ay7": "0 - 0 | -c -s 0", "Ay8": "0 - 0 | 0 -s -c",
    "Az1": "0 0 + | -c 0 s", "Az2": "0 0 + | 0 -c s", "Az3": "0 0 + | c 0 s", "Az4": "0 0 + | 0 c s",
    "Az5": "0 0 - | 0 c -s", "Az6": "0 0 - | c 0 -s", "Az7": "0 0 - | 0 -c -s", "Az8": "0 0 - | -c 0 -s",
}  # fmt: skip

EARTH_DPH = 15.041067
NOMINAL_C = 25
SET_POINTS_C = [25, 55, 45, 35, 25, 15, 5, 0, -5, -10, -15]  # eleven runs, the nominal temperature twice
RATES_DPS = [1, -1, 3, -3, 5, -5]
DWELL_S = 120.0
DEFAULTS = {"T_nominal_C": NOMINAL_C, "extrapolation": "hold", "attitude_tol_g": 0.05, "ls24_T_set_C": 25}


def stimulus(attitude: str, latitude_deg: float) -> tuple[Array, Array]:
    """Specific force in g and earth rate in °/s of the axes x, y and z, as printed."""
    sine, cosine = math.sin(math.radians(latitude_deg)), math.cos(math.radians(latitude_deg))
    numbers = {"0": 0.0, "+": 1.0, "-": -1.0, "s": sine, "-s": -sine, "c": cosine, "-c": -cosine}
    force, earth = (np.array([numbers[word] for word in part.split()]) for part in PRINTED[attitude].split("|"))
    return force, earth * EARTH_DPH / 3600


@dataclass
class Unit:
    """Three accelerometers and three gyros; zeros and scale factors are straight lines over the sensor temperature.

    A row of a (3, 3) matrix is a channel, its columns are the axes x, y and z; a channel does not see its own axis
    through it.
    """

    zero_pps: Array = field(default_factory=lambda: np.array([35.0, -52.0, 18.0]))  # K0 + K2, at 25 °C
    zero_per_c: Array = field(default_factory=lambda: np.array([0.11, -0.07, 0.13]))
    scale: Array = field(default_factory=lambda: np.array([11_300.0, 11_120.0, 11_450.0]))
    scale_per_c: Array = field(default_factory=lambda: np.array([-0.66, -0.51, 0.4]))
    square_g: Array = field(default_factory=lambda: np.array([20e-6, -35e-6, 50e-6]))
    mis: Array = field(default_factory=lambda: 1e-3 * np.array([[0, 1.2, -0.7], [0.4, 0, 0.9], [-1.1, 0.3, 0]]))
    drift_pps: Array = field(default_factory=lambda: np.array([1.1, -2.2, 0.7]))  # 4000 pulse/° make 1 °/h 1.1 pulse/s
    drift_per_c: Array = field(default_factory=lambda: np.array([0.022, -0.011, 0.03]))
    gyro_scale: Array = field(default_factory=lambda: np.array([4000.0, 4011.0, -3990.0]))
    gyro_scale_per_c: Array = field(default_factory=lambda: np.array([0.24, -0.2, 0.1]))
    gyro_mis: Array = field(default_factory=lambda: 1e-3 * np.array([[0, 0.8, 0.5], [-0.6, 0, 1.1], [0.2, -0.9, 0]]))
    sensitivity: Array = field(
        default_factory=lambda: np.array([[0.11, -0.05, 0.02], [0.03, 0.09, -0.07], [0.01, 0.06, -0.12]])
    )
    warmer_c: tuple[float, float] = (5.0, 3.0)  # accelerometers and gyros above the chamber

    def accelerometer(self, temperature_c: Any) -> tuple[Array, Array]:
        """Zero with K2 in pulse/s, and scale factor in pulse/s/g, of x, y and z."""
        away_c = np.asarray(temperature_c) - NOMINAL_C
        return self.zero_pps + self.zero_per_c * away_c, self.scale + self.scale_per_c * away_c

    def gyro(self, temperature_c: Any) -> tuple[Array, Array]:
        """Zero in pulse/s and scale factor in pulse/°."""
        away_c = np.asarray(temperature_c) - NOMINAL_C
        return self.drift_pps + self.drift_per_c * away_c, self.gyro_scale + self.gyro_scale_per_c * away_c

    def accelerometer_pps(self, force_g: Array, temperature_c: float) -> Array:
        zero, scale = self.accelerometer(temperature_c)
        return zero + scale * (force_g + self.mis @ force_g + self.square_g * (force_g**2 - 1))

    def gyro_pps(self, rate_dps: Array, force_g: Array, temperature_c: float) -> Array:
        zero, scale = self.gyro(temperature_c)
        return zero + scale * (rate_dps + self.gyro_mis @ rate_dps) + self.sensitivity @ force_g


@dataclass
class Records:
    """Rows in the order of acquisition, by set point; every row is a mapping that a test may spoil."""

    positions: Rows
    rates: Rows
    apply: Rows | None = None

    def position(self, set_c: float, name: str) -> dict[str, Any]:
        return next(row for row in self.positions if row["T_set_C"] == set_c and row["pos"] == name)

    def rate(self, set_c: float, axis: str, rate_dps: float) -> dict[str, Any]:
        wanted = (set_c, axis, rate_dps)
        return next(row for row in self.rates if (row["T_set_C"], row["axis"], row["rate_cmd_dps"]) == wanted)


def records(
    unit: Unit,
    set_points_c: Sequence[float] = tuple(SET_POINTS_C),
    *,
    latitude_deg: float = 34.25,
    rng: np.random.Generator | None = None,
    noise_counts: tuple[float, float] = (0.0, 0.0),
    leak_dps: float = 0.0,
) -> Records:
    """Records of a bench of the unit; noise is that of the accelerometers' and gyros' counts, rounded then.

    `leak_dps` is what partial turns at ±1 °/s let in, with the sign of the rate.
    """
    made = Records([], [])
    for set_c in set_points_c:
        acc_c, gyro_c = (set_c + warmer_c for warmer_c in unit.warmer_c)
        reported = dict.fromkeys(("Tax", "Tay", "Taz"), acc_c) | dict.fromkeys(("Tgx", "Tgy", "Tgz"), gyro_c)

        def counts(pps: Array, noise: float) -> list[float]:
            exact = np.asarray(pps) * DWELL_S
            return (exact if rng is None else np.round(exact + noise * rng.standard_normal(3))).tolist()

        for name in PRINTED:
            force_g, earth_dps = stimulus(name, latitude_deg)
            acc = counts(unit.accelerometer_pps(force_g, acc_c), noise_counts[0])
            gyro = counts(unit.gyro_pps(earth_dps, force_g, gyro_c), noise_counts[1])
            row = {"T_set_C": set_c, "pos": name, "dwell_s": DWELL_S}
            made.positions.append(row | named("N", acc) | named("W", gyro) | reported)
        for axis, letter in enumerate("xyz"):
            for rate_dps in RATES_DPS:
                up = np.eye(3)[axis]
                true_dps = rate_dps * 1.0002  # the table's encoder knows better than the command
                earth_dps = EARTH_DPH / 3600 * math.sin(math.radians(latitude_deg))
                leak = leak_dps * np.sign(rate_dps) if abs(rate_dps) == 1 else 0.0
                pps = unit.gyro_pps(up * (true_dps + earth_dps + leak), up, gyro_c)
                row = {"T_set_C": set_c, "axis": letter, "rate_cmd_dps": rate_dps, "rate_true_dps": true_dps}
                row |= {"dwell_s": DWELL_S}
                made.rates.append(row | named("W", counts(pps, noise_counts[1])) | reported)
    return made


def named(name: str, values: Sequence[float]) -> dict[str, float]:
    return {f"{name}{axis}": value for axis, value in zip("xyz", values, strict=True)}


def write_case(folder: Path, made: Records, site: dict[str, Any] | None = None, **settings: Any) -> Path:
    """Write `case.json` and its records; None becomes a blank, a setting of None is left out."""
    names = {}
    for name in ("positions", "rates", "apply"):
        rows = getattr(made, name)
        if rows is not None:
            header = list(rows[0])
            lines = [",".join(header)]
            lines += [",".join("" if row.get(key) is None else f"{row[key]}" for key in header) for row in rows]
            (folder / f"{name}.csv").write_text("\n".join(lines) + "\n")
            names[name] = f"{name}.csv"
    content = {
        "schema": "itb-case/1",
        "method": "M2",
        "site": {"lat_deg": 34.25, "h_m": 420} if site is None else site,
        "settings": {key: value for key, value in (DEFAULTS | settings).items() if value is not None},
        "records": names,
    }
    path = folder / "case.json"
    path.write_text(json.dumps(content))
    return path
