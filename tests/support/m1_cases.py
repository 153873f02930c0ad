"""Cases of method M1 made from a known accelerometer on an indexing table: records, settings, and what is true.

The specific force is turned into the unit's axes as a vector, not by the formulas of the reduction.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

Rows = list[dict[str, Any]]
COLUMNS = ("end", "pass", "seq", "theta_deg", "V_mean", "V_std", "n", "stable")


@dataclass(frozen=True)
class Unit:
    """U = c0 + c1 a + c2 a² + c3 a³ + c_xz a a_z in V; the input axis is turned by `delta_rad` towards +z."""

    c0: float = 8e-4
    c1: float = 1.13
    c2: float = 0.0
    c3: float = 0.0
    cxz: float = 0.0
    delta_rad: float = 6e-4

    def output_v(self, force_g: np.ndarray) -> float:
        """At a specific force (3,) in the axes of the unit's case."""
        sine, cosine = np.sin(self.delta_rad), np.cos(self.delta_rad)
        a, a_z = np.array([[cosine, 0, sine], [-sine, 0, cosine]]) @ force_g
        return self.c0 + self.c1 * a + self.c2 * a**2 + self.c3 * a**3 + self.cxz * a * a_z


def force_g(table_rad: float, end: str) -> np.ndarray:
    """Specific force (3,) in the unit's axes, at rest: x rises with the table, z is up or down at table angle 0."""
    up = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]] if end == "up" else [[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
    sine, cosine = np.sin(table_rad), np.cos(table_rad)
    return up @ np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]]) @ np.array([0, 0, 1.0])


def sweep(
    unit: Unit,
    rng: np.random.Generator,
    *,
    largest_deg: float = 10.0,
    angles: int = 21,
    ends: Sequence[str] = ("up", "down"),
    noise_v: float = 0.0,
    drift_v: float = 0.0,
    loop_v: float = 0.0,
    tilt_rad: float = 0.0,
    angles_deg: Iterable[float] | None = None,
) -> Rows:
    """There and back over the angles at each end; the bias drifts from dwell to dwell over both ends.

    `loop_v` is the hysteresis, largest in the middle of the sweep; `tilt_rad` raises the input axis at every angle.
    """
    listed = list(np.linspace(-largest_deg, largest_deg, angles) if angles_deg is None else angles_deg)
    rows: Rows = []
    for end in ends:
        for direction, path in (("fwd", listed), ("rev", listed[::-1])):
            for angle_deg in path:
                output_v = unit.output_v(force_g(np.radians(angle_deg) + tilt_rad, end)) + drift_v * len(rows)
                output_v += (direction == "rev") * loop_v * (1 - (angle_deg / listed[-1]) ** 2)
                rows.append(dict(zip(COLUMNS, (
                    end, direction, len(rows), round(float(angle_deg), 9), output_v + noise_v * rng.standard_normal(),
                    noise_v * 5, 25, 1,
                ), strict=True)))  # fmt: skip
    return rows


def clock(
    unit: Unit, rng: np.random.Generator, tilt_rad: tuple[float, float], *, noise_v: float = 0.0,
    psi_deg: Sequence[float] = (0, 90, 180, 270),
) -> Rows:  # fmt: skip
    """Table at 0°, the unit turned by ψ on a seat that is tilted along and across the input axis of ψ = 0."""
    rows = []
    for psi in psi_deg:
        along = tilt_rad[0] * np.cos(np.radians(psi)) + tilt_rad[1] * np.sin(np.radians(psi))
        rows.append({"psi_deg": psi, "V": unit.output_v(force_g(along, "up")) + noise_v * rng.standard_normal()})
    return rows


def write_case(folder: Path, settings: Mapping[str, Any], **records: Rows) -> Path:
    """Write `case.json` and its records; None becomes a blank."""
    for name, rows in records.items():
        lines = [",".join(rows[0])] + [",".join("" if v is None else f"{v}" for v in row.values()) for row in rows]
        (folder / f"{name}.csv").write_text("\n".join(lines) + "\n")
    content = {
        "schema": "itb-case/1",
        "method": "M1",
        "site": {"lat_deg": 34.25, "h_m": 420},
        "settings": dict(settings),
        "records": {name: f"{name}.csv" for name in records},
    }
    path = folder / "case.json"
    path.write_text(json.dumps(content))
    return path
