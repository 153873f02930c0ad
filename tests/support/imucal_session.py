"""Readings of a real six-axis sensor with the calibration that imucal publishes of them, from `imucal_session.csv`.

The sensor was laid on its six faces by hand (Ferraris et al., 1995). Published is `tests/snapshots/example_cal.json` of
the same repository, found from the whole sections, thousands of rows; the file here has some 40 rows of each section at
rest. The three full turns of the session are not in it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bench.analysis.attitudes import NAMES, block

FILE = Path(__file__).with_suffix(".csv")
RATE_HZ = 204.8
GRAVITY_MPS2 = 9.81  # what imucal takes 1 g to be
PARTS = ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a")  # the axis that reads +1 g, then -1 g

# Rows are those of the sensors x, y and z; b in units of the reading, K_a in units per m/s².
B_A = np.array([-6.018868019671572, -48.287874016760156, -28.96636637224333])
K_A = np.array([208.54567263762615, 208.0011341167055, 214.78455364603022])
R_A = np.array([
    [0.9999125214309234, 0.007122056140390757, -0.011145662922687352],
    [-0.007947378455060604, 0.9996887358297629, 0.023648903373787954],
    [0.021342900724016442, -0.010781879507682177, 0.9997140749549175],
])  # fmt: skip
B_G = np.array([1.960686204431737, -4.472837741243746, -3.6511794138670477])


def sections() -> dict[str, np.ndarray]:
    """The readings (40, 6) of each part: accelerometers x, y and z, gyros x, y and z."""
    lines = [line for line in FILE.read_text().splitlines() if not line.startswith("#")][1:]
    rows = [line.split(",") for line in lines]
    return {part: np.array([row[2:] for row in rows if row[0] == part], dtype=np.float64) for part in PARTS}


def in_attitudes(values: dict[str, np.ndarray]) -> np.ndarray:
    """One row of values for each part, where M2 has its first attitude of that axis up and down: (24, n), else NaN."""
    placed = np.full((len(NAMES), len(values["x_p"])), np.nan)
    for axis in range(3):
        own = block(axis)
        placed[own.start], placed[own.start + 4] = values[PARTS[2 * axis]], values[PARTS[2 * axis + 1]]
    return placed
