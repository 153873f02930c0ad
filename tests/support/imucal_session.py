"""Readings of a real six-axis sensor with the calibration that imucal publishes of them.

The sensor was laid on its six faces by hand (Ferraris et al., 1995). Published is `tests/snapshots/example_cal.json` of
the same repository, found from the whole sections, thousands of rows. `imucal_session.csv` has some 40 rows of each
section at rest, `imucal_turn.csv` what gyro z read in the whole section in which the sensor was turned by 360° about z;
the turns about x and y are not here.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bench.methods.imu.reduction.attitudes import NAMES, block

FILE = Path(__file__).with_suffix(".csv")
TURN = FILE.with_name("imucal_turn.csv")
TURN_DEG = -360.0  # about z up, clockwise
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
K_G = np.array([16.67769558952488, 16.187895200550262, 16.253362639451936])  # in units per °/s
R_G = np.array([
    [-0.9999143756542296, -0.0006142300632876558, 0.013071498821540703],
    [0.0055057030733027396, -0.9992594967426224, -0.03808077472097593],
    [-0.01314650914177706, 0.0365074524847183, -0.9992469040284595],
])  # fmt: skip
K_GA_ZZ = -0.003935382156556474  # of gyro z by gravity along z, in units per m/s²
B_G = np.array([1.960686204431737, -4.472837741243746, -3.6511794138670477])


def sections() -> dict[str, np.ndarray]:
    """The readings (40, 6) of each part: accelerometers x, y and z, gyros x, y and z."""
    lines = [line for line in FILE.read_text().splitlines() if not line.startswith("#")][1:]
    rows = [line.split(",") for line in lines]
    return {part: np.array([row[2:] for row in rows if row[0] == part], dtype=np.float64) for part in PARTS}


def turn() -> np.ndarray:
    """The readings (n,) of gyro z while it was turned by `TURN_DEG`."""
    lines = [line.split(",")[1:] for line in TURN.read_text().splitlines() if not line.startswith("#")]
    return np.array([value for line in lines for value in line], dtype=np.float64)


def in_attitudes(values: dict[str, np.ndarray]) -> np.ndarray:
    """One row of values for each part, where M2 has its first attitude of that axis up and down: (24, n), else NaN."""
    placed = np.full((len(NAMES), len(values["x_p"])), np.nan)
    for axis in range(3):
        own = block(axis)
        placed[own.start], placed[own.start + 4] = values[PARTS[2 * axis]], values[PARTS[2 * axis + 1]]
    return placed
