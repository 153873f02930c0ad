"""Calibrations on an indexing table with a known unit, as a run records them, through the real reduction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bench.methods.indexing.method import INDEXING_STATIC
from bench.methods.indexing.reduction.run import reduce
from bench.metrology.acquisition import Acquisition, Mount, Voltages
from bench.metrology.bench_uncertainty import AxisRecord, BenchRecord
from bench.metrology.results.finding import UnitResult
from bench.metrology.run_data import RunData, UnitUnderTest
from simulators.physics import attitude

ANGLES_DEG = (-1.0, -0.5, 0.0, 0.5, 1.0, 1.0, 0.5, 0.0, -0.5, -1.0)
BENCH = BenchRecord(
    gravity_mps2=9.8, gravity_u_mps2=0.0, axes={"head": AxisRecord((0.0, -1.0, 0.0))}, x=(1.0, 0.0, 0.0),
    z=(0.0, 0.0, 1.0), level_deg=0.0, level_u_deg=0.0, time_base_u=0.0, thermometers_u={},
)  # fmt: skip
UNIT = UnitUnderTest("a", "S1", "", 0.0, "t", voltmeter="dvm", nominal_per_g=1.0)
K1, K0, TOWARDS_Z, TOWARDS_Y, KIP, KIO = -2.0, 1e-3, 4e-4, -7e-4, 3e-5, -9e-5
TILTED_RAD = 5e-5  # of the whole table; times a misalignment it would look like a coupling of 4e-8


class Swept(NamedTuple):
    """A sweep: group of its steps, mount, and the unit as it is then."""

    group: str
    mount: Mount
    k0: float = K0
    k1: float = K1
    saturated: bool = False
    angles_deg: tuple[float, ...] = ANGLES_DEG


ENDS = (Swept("end=up", Mount("end_up")), Swept("end=down", Mount("end_down", roll_deg=180.0)))
SIDES = (Swept("side=up", Mount("side_up", roll_deg=90.0)), Swept("side=down", Mount("side_down", roll_deg=-90.0)))


def calibrated(sweeps: Sequence[Swept], noise_g: float = 0.0, seed: int = 1) -> UnitResult:
    """Reduce sweeps in their order, without errors of the bench."""
    rng, acquisitions = np.random.default_rng(seed), list[Acquisition]()
    for sweep in sweeps:
        for angle_deg in sweep.angles_deg:
            number, mount = len(acquisitions), sweep.mount
            upward = attitude.raised(angle_deg + np.degrees(TILTED_RAD)) @ np.array([0.0, 0.0, 1.0])
            seat = attitude.Mount(mount.angle_deg, mount.roll_deg, mount.clock_deg)
            along, across, pendulous = attitude.to_unit(seat, 0.0) @ upward
            sensed = along + TOWARDS_Z * pendulous + TOWARDS_Y * across + noise_g * rng.standard_normal()
            volts = (
                99.0 if sweep.saturated else sweep.k1 * (sweep.k0 + sensed + along * (KIP * pendulous + KIO * across))
            )
            acquisitions.append(Acquisition(
                step=f"steps/{sweep.group}/angle={number}/acquire", group="", loops={}, begin_s=60.0 * number,
                end_s=60.0 * number + 60.0, angles_deg={"head": angle_deg}, set_from_c=np.nan, set_c=np.nan, counts={},
                temperatures_c={"t": np.array([20.0])}, temperatures_at_s={"t": np.zeros(1)}, mount=mount,
                voltages={"dvm": Voltages(60.0 * number + np.array([20.0, 40.0]), np.full(2, volts))},
                stand=number, came_from={"head": "below" if number % 10 < 5 else "above"},
            ))  # fmt: skip
    settings = INDEXING_STATIC.settings.model_validate({"output_limit": "50 g", "outlier_k": 100}).model_dump()
    (result,) = reduce(RunData("m1", (UNIT,), tuple(acquisitions), BENCH), settings)
    return result
