"""GUM supplement 1 for the calibration on an indexing table: all inputs drawn, and pushed through the real reduction.

As in `test_monte_carlo.py` the scatter of the results has to be as large as their analytic uncertainties say.
"""

from dataclasses import replace

import numpy as np
import pytest

from bench.methods.indexing.method import INDEXING_STATIC
from bench.methods.indexing.reduction.run import reduce
from bench.metrology.acquisition import Acquisition, Mount, Voltages
from bench.metrology.bench_uncertainty import AxisRecord, BenchRecord
from bench.metrology.run_data import RunData, UnitUnderTest

TRIALS = 250
ARCSEC_DEG = 1 / 3600
G, G_U = 9.8, 2e-4
GAIN_U, OFFSET_U_V = 4e-6, 1e-6
ZERO_U_DEG, HARMONIC_U_DEG, REPEATABILITY_U_DEG, LEVEL_U_DEG, BACKLASH_U_DEG = (
    each * ARCSEC_DEG for each in (5, 1, 0.1, 2, 0.1)
)
BENCH = BenchRecord(
    gravity_mps2=G, gravity_u_mps2=G_U,
    axes={"head": AxisRecord((0.0, -1.0, 0.0), ZERO_U_DEG, (HARMONIC_U_DEG,) * 4, REPEATABILITY_U_DEG, BACKLASH_U_DEG)},
    x=(1.0, 0.0, 0.0), z=(0.0, 0.0, 1.0), level_deg=0.0, level_u_deg=LEVEL_U_DEG, time_base_u=0.0,
    thermometers_u={}, voltmeters_u={"dvm": (GAIN_U, OFFSET_U_V)},
)  # fmt: skip
PERFECT = replace(
    BENCH, gravity_u_mps2=0.0, axes={"head": AxisRecord((0.0, -1.0, 0.0))}, level_u_deg=0.0, voltmeters_u={}
)
UNIT = UnitUnderTest("a", "S1", "", 0.0, "t", voltmeter="dvm", nominal_per_g=1000.0)
K0, K1, MISALIGNMENT, KIP = 1e-4, 1000.0, 2e-4, 1e-5
MISALIGNMENT_Y, KIO = -3e-4, 2e-5
NOISE_G = 15e-9
ONE_WAY_DEG = (0.0, 0.25, 0.5)
WAYS = (("forward", ONE_WAY_DEG), ("reverse", ONE_WAY_DEG[::-1]))
SWEEP = [(sign * angle, way) for sign in (1, -1) for way, angles in WAYS for angle in angles]
ENDS = {"up": Mount("end_up"), "down": Mount("end_down", roll_deg=180.0)}
SIDES = {"+y": Mount("side_up", roll_deg=90.0), "-y": Mount("side_down", roll_deg=-90.0)}
CLOCKED = tuple(Mount(f"clock_{angle}", clock_deg=float(angle)) for angle in (0, 90, 180, 270))


class Run:
    """A calibration on a bench with errors drawn, and the errors; `tilt_rad` is more tilt of the seat."""

    def __init__(self, rng, *, perfect, tilt_rad=0.0):
        self._rng, size = rng, 0.0 if perfect else 1.0
        self.zero_rad, self.level_rad = np.radians((ZERO_U_DEG, LEVEL_U_DEG)) * rng.standard_normal(2) * size
        self.harmonics_rad = np.radians(HARMONIC_U_DEG) * rng.standard_normal((4, 2)) * size
        self.level_rad += tilt_rad
        self.gain, self.offset_v = np.array((GAIN_U, OFFSET_U_V)) * rng.standard_normal(2) * size
        self.gravity_mps2 = G + G_U * rng.standard_normal() * size
        self._repeatability_rad = np.radians(REPEATABILITY_U_DEG) * size
        self._backlash_rad = np.radians(BACKLASH_U_DEG) * size * rng.standard_normal()
        self.acquisitions, self._stand, self._head_deg, self._came_from = [], 0, -1.0, ""
        self._stands_rad = 0.0
        for end, mount in {**ENDS, **SIDES}.items():
            for angle_deg, way in SWEEP:
                self._read(f"steps/end={end}/{way}={angle_deg:g}", {way: angle_deg}, angle_deg, mount)
        for mount in CLOCKED:
            self._read("steps/clocking", {}, 0.0, mount)

    def _go(self, angle_deg):
        """Straight to an angle: the head comes back anew, and shows its backlash, where it moves."""
        if angle_deg != self._head_deg:
            self._came_from = "below" if angle_deg > self._head_deg else "above"
            self._head_deg, self._stand = angle_deg, self._stand + 1
            self._stands_rad = self._repeatability_rad * self._rng.standard_normal()
            self._stands_rad += self._backlash_rad * (self._came_from == "above")

    def head_rad(self, angle_deg):
        turns = np.radians(angle_deg) * np.arange(1, 5)
        return self.zero_rad + self.harmonics_rad[:, 0] @ np.cos(turns) + self.harmonics_rad[:, 1] @ np.sin(turns)

    def _read(self, group, loops, angle_deg, mount):
        self._go(angle_deg)
        turn = np.radians(angle_deg) + self.head_rad(angle_deg) + self.level_rad + self._stands_rad
        roll, clock = np.radians((mount.roll_deg, mount.clock_deg))
        along, normal, across = np.sin(turn) * np.cos(clock), np.cos(roll) * np.cos(turn), np.sin(roll) * np.cos(turn)
        force_g = along + MISALIGNMENT * normal + KIP * along * normal + K0 + NOISE_G * self._rng.standard_normal()
        force_g += MISALIGNMENT_Y * across + KIO * along * across
        read_v = K1 * force_g * (1 + self.gain) + self.offset_v
        number = len(self.acquisitions)
        self.acquisitions.append(
            Acquisition(
                step=f"{group}/acquire#{number}", group=group, loops=loops, begin_s=60.0 * number,
                end_s=60.0 * number + 60.0, angles_deg={"head": angle_deg}, set_from_c=np.nan, set_c=np.nan, counts={},
                temperatures_c={"t": np.array([20.0])}, temperatures_at_s={"t": np.zeros(1)}, mount=mount,
                voltages={"dvm": Voltages(60.0 * number + np.array([20.0, 40.0]), np.full(2, read_v))},
                came_from={"head": self._came_from}, stand=self._stand,
            )
        )  # fmt: skip

    def truth(self):
        level_g, head_g = np.sin(self.level_rad), np.sin(self.head_rad(0.0))
        return {
            "K0": K0, "K1": K1, "K1_si": K1 / self.gravity_mps2, "misalignment": MISALIGNMENT, "Kip": KIP,
            "scale_difference": 2 * KIP, "bias": K1 * K0, "bias_corrected": K1 * K0, "b3": K1 * level_g,
            "b5": K1 * head_g, "misalignment_y": MISALIGNMENT_Y, "Kio": KIO,
        }  # fmt: skip


def trials(*, perfect):
    """Errors and uncertainties by quantity, (n, 2)."""
    rng, settings = np.random.default_rng(12), INDEXING_STATIC.settings.model_validate({}).model_dump()
    found = {}
    for _ in range(TRIALS):
        run = Run(rng, perfect=perfect)
        bench = PERFECT if perfect else BENCH
        (result,) = reduce(RunData("indexing", (UNIT,), tuple(run.acquisitions), bench), settings)
        truth = run.truth()
        for each in result.findings:
            if each.quantity in truth:
                found.setdefault(each.quantity, []).append((each.value - truth[each.quantity], each.u))
    return {quantity: np.array(rows) for quantity, rows in found.items()}


@pytest.fixture(scope="module")
def full():
    return trials(perfect=False)


@pytest.fixture(scope="module")
def perfect():
    return trials(perfect=True)


QUANTITIES = (
    "K0",
    "K1",
    "K1_si",
    "misalignment",
    "Kip",
    "scale_difference",
    "bias",
    "bias_corrected",
    "b3",
    "b5",
    "Kio",
    "misalignment_y",
)


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_the_uncertainties_are_those_of_repeated_calibrations(full, quantity):
    scatter, u = np.sqrt(np.mean(full[quantity] ** 2, axis=0))
    assert scatter == pytest.approx(u, rel=0.1)


@pytest.mark.parametrize(
    "quantity", ["K0", "K1", "misalignment", "Kip", "scale_difference", "bias", "Kio", "misalignment_y"]
)
def test_without_errors_of_the_bench_the_scatter_of_the_readings_is_all_there_is(perfect, quantity):
    scatter, u = np.sqrt(np.mean(perfect[quantity] ** 2, axis=0))
    assert scatter == pytest.approx(u, rel=0.1)
