"""GUM supplement 1 (JCGM 101): all inputs of the budgets drawn, and pushed through the real reductions.

The scatter of the results has to be as large as their analytic uncertainties say, within 10 %; largest values apart,
which have a trial of their own (bench/metrology/extremes.py). The error of a result at a dwell is that against what the
unit is at the temperature that the result states.
"""

from functools import lru_cache
from unittest import mock

import numpy as np
import pytest

from bench.methods.ramp.method import TEMPERATURE_RAMP
from bench.methods.ramp.reduction import run as temperature_ramp
from bench.methods.ramp.reduction.samples import RampLeg
from bench.methods.tumble.method import TEMPERATURE_TUMBLE
from bench.methods.tumble.reduction import dwells
from bench.methods.tumble.reduction.run import reduce as reduce_tumble
from bench.metrology import largest
from bench.metrology.acquisition import Acquisition, Counts, Mount
from bench.metrology.bench_uncertainty import AxisRecord, BenchRecord
from bench.metrology.orientation import elevation_rad
from bench.metrology.run_data import RunData, UnitUnderTest

G, G_U = 9.8, 2e-4
ARCSEC_DEG = 1 / 3600
OFFSET_U_C, GAIN_U = 0.3, 1e-3
TIME_BASE_U, LEVEL_U_DEG, ZERO_U_DEG, REPEATABILITY_U_DEG = 0.5e-6, 2 * ARCSEC_DEG, 5 * ARCSEC_DEG, 0.1 * ARCSEC_DEG
HARMONICS_U_DEG = (ARCSEC_DEG,) * 4
BENCH = BenchRecord(
    gravity_mps2=G, gravity_u_mps2=G_U,
    axes={"head": AxisRecord((0.0, -1.0, 0.0), ZERO_U_DEG, HARMONICS_U_DEG, REPEATABILITY_U_DEG)},
    x=(1.0, 0.0, 0.0), z=(0.0, 0.0, 1.0), level_deg=0.0, level_u_deg=LEVEL_U_DEG, time_base_u=TIME_BASE_U,
    thermometers_u={"t": (OFFSET_U_C, GAIN_U)},
)  # fmt: skip
UNIT = UnitUnderTest("a", "S1", "x", 0.0, "t")
K0, K0_SLOPE, K1, K1_SLOPE, K2, MISALIGNMENT = 8e-4, 10e-6, 11_300.0, -58e-6, 35e-6, 3e-4
TICK_S = 1e-6


def counts(rates_pps, gate_s, rng, clock=0.0):
    """Latches at the ends of consecutive gates, whose lengths the device's clock tells wrong."""
    pulses = np.concatenate([[0.0], np.cumsum(rates_pps * gate_s)]) + rng.uniform()
    number = np.arange(len(pulses))
    return Counts(
        sequence=number, tick=np.rint(number * gate_s * (1 + clock) / TICK_S).astype(np.int64) % 2**32,
        positive=np.maximum(np.floor(pulses), 0).astype(np.int64) % 2**32,
        negative=np.maximum(-np.floor(pulses), 0).astype(np.int64) % 2**32, host_s=number * gate_s, tick_bits=32,
        counter_bits=32, tick_period_s=TICK_S, max_rate_pps=256e3, lost=0, restarts=0,
    )  # fmt: skip


@lru_cache
def known_elevation_rad(angle_deg):
    """The angles are the same in every draw."""
    orientation = mock.Mock(angles_deg={"head": angle_deg}, mount=Mount())
    return elevation_rad(orientation, UNIT, BENCH)


class Errors:
    """Those of the bench in one draw."""

    def __init__(self, rng):
        self._rng = rng
        self.zero_rad = np.radians(ZERO_U_DEG * rng.standard_normal() + LEVEL_U_DEG * rng.standard_normal())
        self.harmonics_rad = np.radians(np.outer(HARMONICS_U_DEG, (1, 1)) * rng.standard_normal((4, 2)))
        self.clock = TIME_BASE_U * rng.standard_normal()
        self.gravity_mps2 = G + G_U * rng.standard_normal()
        self.offset_c, self.gain = OFFSET_U_C * rng.standard_normal(), GAIN_U * rng.standard_normal()

    def true_rad(self, angle_deg):
        turn = np.radians(angle_deg)
        orders = np.arange(1, 5)
        lasting = self.harmonics_rad[:, 0] @ np.cos(orders * turn) + self.harmonics_rad[:, 1] @ np.sin(orders * turn)
        repeatability = np.radians(REPEATABILITY_U_DEG) * self._rng.standard_normal()
        return turn + self.zero_rad + lasting + repeatability

    def indicated_c(self, temperature_c):
        return temperature_c * (1 + self.gain) + self.offset_c


# The static tumble

SET_C = (-40.0, -10.0, 20.0, 45.0, 70.0)
POSITIONS_DEG = tuple(1.0 + at for at in (0, 90, 180, 270, 270, 180, 90, 0))
GATE_S, NOISE_PPS = 60.0, 0.03
AT_DWELLS = ("K0", "K1", "K1_si", "K2", "misalignment")
OVER_TEMPERATURE = ("K0/temperature_coefficient", "K1/temperature_coefficient", "K0T1", "K0T2", "K1T1", "K1T2")


def constants(temperature_c, gravity_mps2):
    away_c = temperature_c - 20
    k1 = K1 * (1 + K1_SLOPE * away_c)
    values = (K0 + K0_SLOPE * away_c, k1, k1 / gravity_mps2, K2, MISALIGNMENT)
    return dict(zip(AT_DWELLS, values, strict=True))


def tumble(rng):
    """A run and the errors that it was made with."""
    errors, acquisitions = Errors(rng), []
    for set_c in SET_C:
        unit = constants(set_c, G)
        for number, angle_deg in enumerate(POSITIONS_DEG):
            turn = errors.true_rad(angle_deg)
            force = np.sin(turn) + unit["misalignment"] * np.cos(turn) + unit["K2"] * np.sin(turn) ** 2
            rate_pps = unit["K1"] * (unit["K0"] + force) + NOISE_PPS * rng.standard_normal()
            group = f"steps/temperature={set_c:g}"
            acquisitions.append(
                Acquisition(
                    step=f"{group}/{number}",
                    group=group,
                    loops={},
                    begin_s=(at_s := (8 * SET_C.index(set_c) + number) * (GATE_S + 5)),
                    end_s=at_s + GATE_S,
                    angles_deg={"head": angle_deg},
                    set_from_c=set_c,
                    set_c=set_c,
                    counts={"x": counts(np.full(1, rate_pps), GATE_S, rng, errors.clock)},
                    temperatures_c={"t": np.array([errors.indicated_c(set_c)])},
                    temperatures_at_s={"t": np.zeros(1)},
                )
            )
    return RunData("tumble", (UNIT,), tuple(acquisitions), BENCH), errors


def tumbled(trials):
    """Errors and uncertainties of every finding that is no largest value, by quantity and where it is."""
    rng, settings = np.random.default_rng(1), TEMPERATURE_TUMBLE.settings.model_validate({"degree": 2}).model_dump()
    truth = {"K0/temperature_coefficient": K0_SLOPE, "K0T1": K0_SLOPE, "K1T1": K1_SLOPE, "K0T2": 0.0, "K1T2": 0.0}
    found = {}
    for _ in range(trials):
        data, errors = tumble(rng)
        (result,) = reduce_tumble(data, settings)
        for each in result.findings:
            if each.quantity in AT_DWELLS:
                true = constants(each.at["temperature_c"], errors.gravity_mps2)[each.quantity]
            elif each.quantity == "K1/temperature_coefficient":
                true = K1_SLOPE / (1 + K1_SLOPE * (np.mean(SET_C) - 20))
            elif each.quantity in truth:
                true = truth[each.quantity]
            else:
                continue
            found.setdefault((each.quantity, each.at.get("dwell")), []).append((each.value - true, each.u))
    return {key: np.array(rows) for key, rows in found.items()}


@pytest.fixture(scope="module")
def tumbles():
    with mock.patch.object(dwells, "elevation_rad", lambda each, *_: known_elevation_rad(each.angle_deg)):
        return tumbled(300)


@pytest.mark.parametrize("quantity", [*AT_DWELLS, *OVER_TEMPERATURE])
def test_the_uncertainties_of_a_tumble_are_those_of_repeated_tumbles(tumbles, quantity):
    rows = np.concatenate([rows for (name, _), rows in tumbles.items() if name == quantity])
    scatter, u = np.sqrt(np.mean(rows[:, 0] ** 2)), np.sqrt(np.mean(rows[:, 1] ** 2))
    assert scatter == pytest.approx(u, rel=0.1)


def test_every_finding_of_a_tumble_is_tried_unless_it_is_a_largest_value(tumbles):
    data, _ = tumble(np.random.default_rng(3))
    (result,) = reduce_tumble(data, TEMPERATURE_TUMBLE.settings.model_validate({"degree": 2}).model_dump())
    found = {each.quantity for each in result.findings if each.interval is None}
    assert {name for name, _ in tumbles} == found


# The dynamic test

LOW_C, HIGH_C, SAMPLES, SAMPLE_S, SAMPLE_PPS, CURVE_G = 20.0, 34.0, 56, 10.0, 0.05, 30e-6
MISALIGNMENT_U = 1e-3
CHANGE_G_PER_C = 0.3e-6  # of the slope of the bias, from cycle to cycle
TRIED = ("K0/temperature_coefficient", "K0/model_residual_rms", "K1/temperature_coefficient")
ONE_WAY_C = np.linspace(LOW_C, HIGH_C, SAMPLES + 1)


def output_g(temperature_c):
    """Bias at 0 g: a straight line and a parabola about it, which leaves its slope as it is."""
    across = (temperature_c - (LOW_C + HIGH_C) / 2) / (HIGH_C - LOW_C) * 2
    return K0 + K0_SLOPE * (temperature_c - 20) + CURVE_G * across**2


def ramp_leg(number, angle_deg, misalignment, change_g_per_c, errors, turn, rng):
    """One of four at an angle, up, down, up, down: its samples as they are cut from counts."""
    edges_c = ONE_WAY_C[:: 1 if number % 2 == 0 else -1]
    middle_c = (edges_c[1:] + edges_c[:-1]) / 2
    bias_g = output_g(middle_c) + change_g_per_c * (middle_c - middle_c.mean())
    force_g = np.sin(turn) + misalignment * np.cos(turn) + bias_g
    rates = K1 * (1 + K1_SLOPE * (middle_c - 20)) * force_g + SAMPLE_PPS * rng.standard_normal(SAMPLES)
    return RampLeg(
        step=f"steps/position={angle_deg:g}/leg={number}/acquire", cycle=1 + number // 2,
        direction=1 if number % 2 == 0 else -1, angle_rad=known_elevation_rad(angle_deg),
        time_s=(8 * angle_deg + number) * SAMPLES * SAMPLE_S + SAMPLE_S * np.arange(SAMPLES),
        temperature_c=errors.indicated_c(middle_c), output=rates / (1 + errors.clock),
        seconds=np.full(SAMPLES, SAMPLE_S), counted=False, problems={},
    )  # fmt: skip


def ramp(rng, change_g_per_c):
    """A run, and by how much the slope of the bias at 0 g was changed on the mean."""
    errors, misalignment = Errors(rng), MISALIGNMENT_U * rng.standard_normal()
    changes = change_g_per_c * rng.standard_normal((2, 2))
    legs = [
        ramp_leg(number, angle_deg, misalignment, changes[part, number // 2], errors, turn, rng)
        for part, angle_deg in enumerate((1.0, 91.0))
        for turn in (errors.true_rad(angle_deg),)
        for number in range(4)
    ]
    return RunData("ramp", (UNIT,), tuple(legs), BENCH, span_s=(0.0, 1e6)), changes[0].mean()


@lru_cache
def ramps(change_g_per_c):
    """Errors, uncertainties, and what they are without the change of the bias, by quantity: (n, 3)."""
    settings = TEMPERATURE_RAMP.settings.model_validate({"misalignment_u": "1 mrad"}).model_dump()
    rng, found = np.random.default_rng(2), {}
    with (
        mock.patch.object(temperature_ramp, "elevation_rad"),
        mock.patch.object(temperature_ramp, "cut_into_samples", lambda leg, *_: leg),
        mock.patch.object(largest, "TRIALS", 2),
    ):
        for _ in range(250):
            data, changed_g_per_c = ramp(rng, change_g_per_c)
            (result,) = temperature_ramp.reduce(data, settings)
            true = true_ramp_figures(changed_g_per_c)
            for each in result.findings:
                if each.quantity in TRIED:
                    calm_u = np.sqrt(sum(line.u**2 for line in each.budget if not line.source.startswith("bias")))
                    found.setdefault(each.quantity, []).append((each.value - true[each.quantity], each.u, calm_u))
    return {quantity: np.array(rows) for quantity, rows in found.items()}


def true_ramp_figures(changed_g_per_c):
    """Of the bias as it was in this run; what it did between its parts is an error of K1 alone."""
    middle_c = (ONE_WAY_C[1:] + ONE_WAY_C[:-1]) / 2
    line = np.polyfit(middle_c, output_g(middle_c), 1)
    k1 = np.polyfit(middle_c, K1 * (1 + K1_SLOPE * (middle_c - 20)), 1)
    rms_g = np.sqrt(np.mean((output_g(middle_c) - np.polyval(line, middle_c)) ** 2))
    return dict(zip(TRIED, (line[0] + changed_g_per_c, rms_g, k1[0] / np.polyval(k1, middle_c.mean())), strict=True))


@pytest.mark.parametrize("quantity", TRIED)
def test_the_uncertainties_of_a_ramp_are_those_of_repeated_ramps(quantity):
    scatter, u, _ = np.sqrt(np.mean(ramps(CHANGE_G_PER_C)[quantity] ** 2, axis=0))
    assert scatter == pytest.approx(u, rel=0.1)


@pytest.mark.parametrize("quantity", TRIED)
def test_where_the_bias_stays_the_other_sources_are_all_there_is(quantity):
    scatter, _, calm_u = np.sqrt(np.mean(ramps(0.0)[quantity] ** 2, axis=0))
    assert scatter == pytest.approx(calm_u, rel=0.1), "the part at 0 g scatters as well"
