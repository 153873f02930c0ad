"""GUM supplement 1 for a channel over temperature: all inputs drawn, and pushed through the real reduction.

As in `test_monte_carlo.py` the scatter of the results has to be as large as their analytic uncertainties say; the
largest departure from the line is no linear function of what is drawn, and its interval has to hold the truth. Errors
of the bench are as large beside the noise as they must be to be seen, and not those of a bench.
"""

from functools import lru_cache

import numpy as np
import pytest

from bench.methods.channel.method import CHANNEL_TEMPERATURE
from bench.methods.channel.reduction.run import reduce
from bench.metrology.acquisition import Acquisition, Counts, Mount
from bench.metrology.bench_uncertainty import BenchRecord, Drift, SourceRecord
from bench.metrology.gate_scatter import STRETCHES
from bench.metrology.run_data import RunData, UnitUnderTest
from tests.support.monte_carlo import found_in, ratio, scatter_is_u, would_be_seen

TRIALS = 400
LOW_C, HIGH_C, REFERENCE_C, RAMP_S, POINT_S, LATCH_S = 10.0, 40.0, 25.0, 1500.0, 300.0, 5.0
S, A_PER_G, ZERO_PPS, ALPHA, BETA, CURVE = 1e7, 1.13e-3, 20.0, 2e-5, 0.1, 3e-8
NOISE = 4e-6  # of the input, of a mean over 1 s
OFFSET_U_C, GAIN_U, TIME_BASE_U, LEVEL_U_DEG = 0.3, 2e-3, 2e-6, 0.15
DRIFT_U_C, RUN_S = 0.2, 8 * POINT_S + 3 * RAMP_S + 9 * LATCH_S  # of the thermometer within a run, and how long that is
SOURCE = SourceRecord(gain_u=3e-6, offset_u_a=2e-9, drift_u_per_s=1e-6 / 3600)
FOLLOWS, ITS_OWN_U = 5e-4, 70e-6  # the accelerometer the converter, by degrees; what its rate makes of a degree
BENCH = BenchRecord(
    gravity_mps2=9.8, gravity_u_mps2=0.0, axes={}, x=(1.0, 0.0, 0.0), z=(0.0, 0.0, 1.0), level_deg=0.0,
    level_u_deg=LEVEL_U_DEG, time_base_u=TIME_BASE_U, thermometers_u={"board": (OFFSET_U_C, GAIN_U)},
    thermometer_drifts={"board": Drift(DRIFT_U_C)},
    sources={"source": SOURCE},
)  # fmt: skip
UNIT = UnitUnderTest("a", "C-7", "x", 0.0, "unit", converter="board", source="source", scale_a_per_g=A_PER_G)
SETTINGS = CHANNEL_TEMPERATURE.settings.model_validate(
    {"threshold": "5 %", "accelerometer": "65 °C", "max_ramp": "120 °C/h", "drift_limit": "1 %"}
).model_dump()
HOLDS = 0.9  # of the draws, that intervals have to hold the truth in; they claim 0.95
LEVELS = (("gravity", 1.0), ("source", 1.0), ("source", 12.0))
RAMPS = ((LOW_C, HIGH_C), (LOW_C, HIGH_C), (HIGH_C, LOW_C))  # one is cooled: a drift tilts its line the other way
OF_A_LEVEL = {"up_1g": 1.0, "src_1g": 1.0, "src_12g": 12.0}


def rate_pps(current_a, board_c):
    warm_c = board_c - REFERENCE_C
    return S * current_a * (1 + ALPHA * warm_c + CURVE * warm_c**2) + ZERO_PPS + BETA * warm_c


class Run:
    """A run on a bench with errors drawn; `begun_s` is when it began."""

    def __init__(self, rng):
        self._rng, draw = rng, rng.standard_normal
        self._clock, self._offset_c, self._gain = np.array([TIME_BASE_U, OFFSET_U_C, GAIN_U]) * draw(3)
        self._drift_c = DRIFT_U_C * draw()
        self._tilt_rad = np.radians(LEVEL_U_DEG) * draw()
        self._source_gain, self._source_offset_a = np.array([SOURCE.gain_u, SOURCE.offset_u_a]) * draw(2)
        self._drift_per_s, self._its_own = np.array([SOURCE.drift_u_per_s, ITS_OWN_U]) * draw(2)
        self._now_s, self.acquisitions = 1000.0, []
        self._acquire("source", 0.0, LOW_C, LOW_C, POINT_S)
        for (kind, level_g), (from_c, to_c) in zip(LEVELS, RAMPS, strict=True):
            for ends_c, seconds in ((from_c, POINT_S), (to_c, RAMP_S), (from_c, POINT_S)):
                self._acquire(kind, level_g, from_c, ends_c, seconds)
        self._acquire("source", 0.0, LOW_C, LOW_C, POINT_S)

    def _input_a(self, kind, level_g, at_s, board_c):
        noisy = 1 + NOISE / np.sqrt(LATCH_S) * self._rng.standard_normal(len(at_s))
        if kind == "gravity":
            held = 1 + self._its_own * FOLLOWS * (board_c - REFERENCE_C)
            return A_PER_G * level_g * np.cos(self._tilt_rad) * held * noisy
        drifted = 1 + self._source_gain + self._drift_per_s * (at_s - 1000.0)
        return A_PER_G * level_g * drifted * noisy + self._source_offset_a

    def _acquire(self, kind, level_g, from_c, to_c, seconds):
        at_s = self._now_s + np.arange(0.0, seconds, LATCH_S)
        self._now_s += seconds + LATCH_S
        board_c = np.linspace(from_c, to_c, len(at_s))
        # What was counted up to a latch is of the mean temperature on the way to it.
        mean_c = np.concatenate([board_c[:1], (board_c[1:] + board_c[:-1]) / 2])
        pulses = rate_pps(self._input_a(kind, level_g, at_s, mean_c), mean_c) * LATCH_S
        counted = np.floor(np.cumsum(pulses) + self._rng.uniform()).astype(np.int64) % 2**24
        number, by_source = np.arange(len(at_s)), kind == "source"
        counts = Counts(
            sequence=number, tick=np.rint(number * LATCH_S * (1 + self._clock) * 1e6).astype(np.int64) % 2**32,
            positive=counted, negative=np.zeros_like(counted), host_s=at_s, tick_bits=32, counter_bits=24,
            tick_period_s=1e-6, max_rate_pps=256e3, lost=0, restarts=0,
        )  # fmt: skip
        self.acquisitions.append(
            Acquisition(
                step=f"steps/acquire#{len(self.acquisitions)}", group="", loops={}, begin_s=float(at_s[0]),
                end_s=float(at_s[-1]), angles_deg={}, set_from_c=from_c, set_c=to_c, counts={"x": counts},
                temperatures_c={
                    "board": board_c * (1 + self._gain) + self._offset_c + self._drifted_c(at_s),
                    "unit": 65.0 + FOLLOWS * (board_c - REFERENCE_C),
                },
                temperatures_at_s={"board": at_s, "unit": at_s}, input="source" if by_source else "accelerometer",
                mount=Mount() if by_source else Mount("up", 90.0),
                sources_a={"source": level_g * A_PER_G} if by_source else {},
            )
        )  # fmt: skip

    def _drifted_c(self, at_s):
        return self._drift_c * ((at_s - 1000.0) / RUN_S - 0.5)

    def drifted(self, found):
        """By how much the input really changed between the points of a level."""
        hours = float(found.name.split(", ")[1].split()[0])
        return 0.0 if found.at["run"] == "up_1g" else self._drift_per_s * hours * 3600


def line(level_g):
    """The straight line over the ramp: the rate at the reference temperature, and its slope."""
    board_c = np.linspace(LOW_C, HIGH_C, 1001)
    slope, rate = np.polyfit(board_c - REFERENCE_C, rate_pps(level_g * A_PER_G, board_c), 1)
    return rate, slope


LINES = {name: line(level_g) for name, level_g in OF_A_LEVEL.items()}
DRIFT = np.polyfit(*np.array(list(LINES.values())).T, 1)


def slope_of(found, name="run"):
    return LINES[found.at[name]][1]


def relative_slope_of(found, name="run"):
    return slope_of(found, name) / LINES[found.at[name]][0]


TRUE = {
    "rate": lambda found: LINES[found.at["run"]][0],
    "rate/temperature_coefficient": slope_of,
    "rate/relative_temperature_coefficient": relative_slope_of,
    "deviation/raw": lambda found: abs(slope_of(found) / slope_of(found, "reference") - 1),
    "deviation/normalised": lambda found: abs(relative_slope_of(found) / relative_slope_of(found, "reference") - 1),
    "tempco_offset": lambda _: DRIFT[1],
    "tempco_scale": lambda _: DRIFT[0],
    "zero": lambda _: rate_pps(0.0, LOW_C),
    "zero/drift": lambda _: 0.0,
}


@lru_cache
def runs(count, seed=3):
    rng = np.random.default_rng(seed)  # whose draws are as wide as those they are from, within 5 %
    drawn = [Run(rng) for _ in range(count)]
    return [(run, reduce(RunData("channel", (UNIT,), tuple(run.acquisitions), BENCH), SETTINGS)[0]) for run in drawn]


@lru_cache
def trials(count=TRIALS, seed=3):
    return found_in((result, TRUE | {"rate/drift": run.drifted}) for run, result in runs(count, seed))


@pytest.mark.parametrize("quantity", [*TRUE, "rate/drift"])
def test_the_uncertainties_of_a_channel_are_those_of_repeated_runs(quantity):
    rows = trials()[quantity]
    assert scatter_is_u(rows), ratio(rows)


def true_departure(level_g):
    """The largest of the means over the stretches of a ramp, without noise, relative to the rate."""
    board_c = np.linspace(LOW_C, HIGH_C, 50 * STRETCHES)
    rate, slope = line(level_g)
    away_pps = rate_pps(level_g * A_PER_G, board_c) - rate - slope * (board_c - REFERENCE_C)
    return np.max(np.abs(away_pps.reshape(STRETCHES, -1).mean(axis=1))) / rate


def test_the_interval_of_the_largest_departure_holds_it():
    held, narrow = [], []
    for _, result in runs(TRIALS):
        for found in result.findings:
            if found.quantity == "rate/model_residual":
                true = true_departure(OF_A_LEVEL[found.at["run"]])
                held.append(found.interval.low <= true <= found.interval.high)
                narrow.append(found.value - found.u <= true <= found.value + found.u)
    assert len(held) == len(LEVELS) * TRIALS
    assert np.mean(held) >= HOLDS
    assert np.mean(narrow) < HOLDS, "an interval of one standard uncertainty is too short"


def test_every_finding_of_a_channel_is_tried():
    _, result = runs(TRIALS)[0]
    assert {found.quantity for found in result.findings} == {*trials(), "rate/model_residual"}


def test_an_uncertainty_that_is_15_percent_off_is_seen():
    assert would_be_seen(trials()["zero"])


class Nothing:
    """Draws that are all in the middle."""

    def standard_normal(self, size=None):
        return 0.0 if size is None else np.zeros(size)

    def uniform(self):
        return 0.5


class Drifting(Run):
    """A run without errors but for a thermometer that drifts by so many standard uncertainties."""

    def __init__(self, times):
        self.times = times
        super().__init__(Nothing())

    def _drifted_c(self, at_s):
        return self.times * DRIFT_U_C * ((at_s - 1000.0) / RUN_S - 0.5)


def test_a_thermometer_that_drifts_by_its_standard_uncertainty_moves_each_finding_by_its_line():
    still, drifted = (
        reduce(RunData("channel", (UNIT,), tuple(Drifting(times).acquisitions), BENCH), SETTINGS)[0].findings
        for times in (0, 1)
    )
    moved = 0
    for before, after in zip(still, drifted, strict=True):
        assert before.id == after.id
        change = abs(after.value - before.value)
        lines = [line.u for line in after.budget if line.source == "board: drift within the run"]
        counted = (before.value * 2e-7) if before.quantity == "rate" else 0.05 * after.u  # whole pulses
        assert change == pytest.approx(sum(lines), rel=0.02, abs=counted)
        moved += change > 0.05 * after.u
    assert moved > 10
