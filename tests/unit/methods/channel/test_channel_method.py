"""A channel over temperature and input level, on counts that were made from known constants."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bench.methods.channel.method import CHANNEL_TEMPERATURE
from bench.methods.channel.reduction.compared_levels import OWN_TEMPERATURE
from bench.methods.channel.reduction.levels import read_out
from bench.methods.channel.reduction.run import reduce
from bench.methods.channel.reduction.transfer_meter import Metered
from bench.metrology import gate_scatter as channel_scatter
from bench.metrology.acquisition import Acquisition, Counts, Currents, Mount
from bench.metrology.bench_uncertainty import AxisRecord, BenchRecord, SourceRecord
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.gate_scatter import line_scatter
from bench.metrology.gates import Gates
from bench.metrology.least_squares import NotDetermined
from bench.metrology.motion_records import CountRecord
from bench.metrology.results.curves import Equation
from bench.metrology.results.finding import Finding, UnitResult
from bench.metrology.results.limits import Limits
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.metrology.velocity import specific_forces
from bench.report.flag_words import flag_in_words
from tests.support.flags import flag_of, texts

LOW_C, HIGH_C, RAMP_S, POINT_S = 10.0, 40.0, 4000.0, 600.0
S, K1, BEGIN_S = 1e7, 1.13e-3, 1000.0  # pulse/s/A, A/g; when the first acquisition begins
ALPHA, BETA = 10e-6, 0.004
FOLLOWS = 0.004  # °C of the accelerometer for 1 °C of the board
SETTINGS = CHANNEL_TEMPERATURE.settings.model_validate(
    {"threshold": "5 %", "accelerometer": "65 °C", "reference_policy": "claim"}
).model_dump()
UNIT = UnitUnderTest("a", "C-7", "x", 0.0, "unit", converter="board", source="source", scale_a_per_g=K1)
BENCH = BenchRecord(
    gravity_mps2=9.8, gravity_u_mps2=0.0, axes={}, x=(1.0, 0.0, 0.0), z=(0.0, 0.0, 1.0), level_deg=0.0,
    level_u_deg=0.001, time_base_u=5e-7, thermometers_u={"board": (0.3, 1e-3)},
    sources={"source": SourceRecord(20e-6, 10e-9, 0.0)},
)  # fmt: skip
MOUNTS = {1.0: Mount("up", 90.0), -1.0: Mount("down", -90.0), 0.577: Mount("skew", float(np.degrees(np.arcsin(0.577))))}


def rate(level_g, board_c, *, alpha=ALPHA, beta=BETA):
    warm = board_c - 25
    return S * K1 * level_g * (1 + alpha * warm) + 2.0 + beta * warm


class Made:
    """Acquisitions one after the other, each a second behind the last; `drift` is of the input in an hour.

    The accelerometer is warmed by 0.004 °C for each °C of the board, and its output changes by `own` for each °C.
    """

    def __init__(self, *, drift=0.0, held_c=65.0, own=0.0, **converter):
        self.acquisitions: list[Acquisition] = []
        self._own = own
        self._now_s, self._drift, self._held_c, self._converter = BEGIN_S, drift, held_c, converter

    def ramp(self, kind, level_g, low_c=LOW_C, high_c=HIGH_C, seconds=RAMP_S):
        self._acquire(kind, level_g, low_c, high_c, seconds)
        return self

    def point(self, kind, level_g, at_c=LOW_C):
        self._acquire(kind, level_g, at_c, at_c, POINT_S)
        return self

    def level(self, kind, level_g):
        return self.point(kind, level_g).ramp(kind, level_g).point(kind, level_g)

    def _acquire(self, kind, level_g, from_c, to_c, seconds):
        at_s = self._now_s + np.arange(0.0, seconds)
        self._now_s += seconds + 1
        board_c = np.linspace(from_c, to_c, len(at_s))
        drifted = 1 + self._drift * (at_s - BEGIN_S) / 3600 if level_g else 1.0
        followed_c = FOLLOWS * (board_c - 25.0)
        drifted = drifted * (1 + (self._own * followed_c if kind == "gravity" else 0.0))
        cumulative = np.cumsum(rate(level_g * drifted, board_c, **self._converter)) + 0.3
        net = np.floor(np.abs(cumulative)).astype(np.int64) % 2**24
        forward = cumulative[-1] > 0
        number = np.arange(len(at_s))
        counts = Counts(
            sequence=number, tick=1_000_000 * number % 2**32, positive=net if forward else 0 * net,
            negative=0 * net if forward else net, host_s=at_s, tick_bits=32, counter_bits=24, tick_period_s=1e-6,
            max_rate_pps=256e3, lost=0, restarts=0,
        )  # fmt: skip
        by_source = kind == "source"
        self.acquisitions.append(Acquisition(
            step=f"steps/acquire#{len(self.acquisitions) + 1}", group="", loops={}, begin_s=float(at_s[0]),
            end_s=float(at_s[-1]), angles_deg={}, set_from_c=from_c, set_c=to_c, counts={"x": counts},
            temperatures_c={"board": board_c, "unit": self._held_c + followed_c},
            temperatures_at_s={"board": at_s, "unit": at_s},
            mount=Mount() if by_source else MOUNTS[level_g], input="source" if by_source else "accelerometer",
            sources_a={"source": level_g * K1} if by_source else {},
        ))  # fmt: skip


def reduced(made: Made, bench: BenchRecord = BENCH, unit: UnitUnderTest = UNIT, **settings: Any) -> UnitResult:
    (result,) = reduce(RunData("channel", (unit,), tuple(made.acquisitions), bench), SETTINGS | settings)
    return result


def found(result: UnitResult) -> dict[str, Finding]:
    return {finding.id.removeprefix("channel/a/"): finding for finding in result.findings}


def four_levels(**converter) -> Made:
    made = Made(**converter)
    for kind, level_g in (("gravity", 1.0), ("gravity", 0.577), ("source", 1.0), ("source", 12.0)):
        made.level(kind, level_g)
    return made.point("source", 0.0)


@pytest.fixture(scope="module")
def usual():
    return reduced(four_levels())


def decisions(result: UnitResult) -> dict[str, tuple[str, str]]:
    return {each.level.name: (each.reference.name, each.comparison.decision) for each in result.detail.compared}


# Lines, levels and coefficients


def test_each_level_has_its_line_within_its_uncertainty(usual):
    results = found(usual)
    for name, level_g in (("up_1g", 1.0), ("skew", 0.577), ("src_1g", 1.0), ("src_12g", 12.0)):
        line = results[f"rate@{name}"], results[f"rate/temperature_coefficient@{name}"]
        assert abs(line[0].value - rate(level_g, 25.0)) < 0.01
        assert abs(line[1].value - (S * K1 * level_g * ALPHA + BETA)) < 1e-4
        relative = results[f"rate/relative_temperature_coefficient@{name}"]
        assert relative.value == pytest.approx(line[1].value / line[0].value)
        assert all(finding.u > 0 for finding in (*line, relative))
    assert usual.left_out == ()


def test_the_two_coefficients_of_the_converter(usual):
    results = found(usual)
    assert results["tempco_scale"].value == pytest.approx(ALPHA, rel=1e-3)
    assert results["tempco_offset"].value == pytest.approx(BETA, rel=0.02)
    assert results["tempco_scale"].budget[0].source == "board: gain"


def test_the_rate_of_a_source_carries_its_certificate_and_that_of_gravity_the_level_of_the_slab(usual):
    results = found(usual)
    of_source = {line.source: line.u for line in results["rate@src_1g"].budget}
    assert of_source["source: gain"] == pytest.approx(20e-6 * rate(1.0, 25.0), rel=1e-3)
    assert of_source["source: offset"] == pytest.approx(10e-9 * S, rel=1e-3)
    shared = [{line.shared for line in results[f"rate@{name}"].budget} for name in ("src_1g", "src_12g")]
    assert {"source.gain", "source.offset"} <= shared[0] & shared[1], "one error of one range"
    of_skew = {line.source: line.u for line in results["rate@skew"].budget}
    assert of_skew["fixture: level"] == pytest.approx(np.radians(0.001) * S * K1 * np.cos(np.arcsin(0.577)), rel=1e-3)
    shared = {line.shared for line in results["rate/temperature_coefficient@skew"].budget}
    assert "board.gain" in shared


def test_a_gain_of_the_thermometer_moves_slopes_and_not_how_they_compare(usual):
    deviation = found(usual)["deviation/normalised@src_12g"]
    assert not any("board" in line.source for line in deviation.budget)


def test_zero_is_what_the_converter_counts_with_nothing_fed(usual):
    zero = found(usual)["zero@src_0g"]
    assert zero.value == pytest.approx(rate(0.0, LOW_C), abs=0.002)
    assert zero.u == pytest.approx(np.hypot(10e-9 * S, 0.408 / (POINT_S - 2)), rel=0.01)


# Decisions, and the trap of raw slopes


def test_a_drift_in_proportion_to_the_level_is_shared_on_the_normalised_basis(usual):
    assert decisions(usual) == {
        "skew": ("up_1g", "share"), "src_1g": ("up_1g", "share"), "src_12g": ("up_1g", "share"),
    }  # fmt: skip
    model = next(each for each in usual.models if isinstance(each, Equation) and each.form.startswith("src_12g"))
    assert ", slope from up_1g, which serves this level too" in model.to_json()["form"]
    assert model.constants["κ"].value == found(usual)["rate/relative_temperature_coefficient@up_1g"].value
    assert texts(usual.flags) == ()


def test_on_the_raw_basis_the_same_drift_is_kept_apart_and_the_report_says_why():
    result = reduced(four_levels(beta=0.0), compare_basis="raw")
    assert decisions(result) == {
        "skew": ("up_1g", "keep"), "src_1g": ("up_1g", "share"), "src_12g": ("up_1g", "keep"),
    }  # fmt: skip
    assert found(result)["deviation/raw@skew"].value == pytest.approx(0.423, abs=1e-3)
    assert found(result)["deviation/raw@src_12g"].value == pytest.approx(11.0, abs=0.01)
    assert texts(result.flags) == ("skew:slope_follows_level", "src_12g:slope_follows_level")
    assert "for this reason alone, which is no fault of the channel" in flag_in_words(result.flags[0])


def test_a_drift_that_is_the_same_at_all_levels_is_kept_apart_on_the_normalised_basis_and_told():
    result = reduced(four_levels(alpha=0.0, beta=0.1))
    assert decisions(result)["src_12g"] == ("up_1g", "keep")
    assert "the drift is an offset" in flag_in_words(flag_of(result.flags, "src_12g:slope_same_at_all_levels"))
    assert decisions(reduced(four_levels(alpha=0.0, beta=0.1), compare_basis="raw"))["src_12g"] == ("up_1g", "share")


def test_by_the_policy_of_the_embodiment_source_levels_are_compared_with_each_other():
    result = reduced(four_levels(), reference_policy="embodiment")
    assert {name: reference for name, (reference, _) in decisions(result).items()} == {
        "skew": "up_1g", "src_1g": "up_1g", "src_12g": "src_1g",
    }  # fmt: skip


def test_a_run_of_the_source_alone_has_a_reference_all_the_same():
    made = Made().level("source", 1.0).level("source", 12.0)
    assert decisions(reduced(made)) == {"src_12g": ("src_1g", "share")}


def test_one_level_alone_is_compared_with_nothing():
    result = reduced(Made().level("gravity", 1.0))
    assert (decisions(result), result.left_out, texts(result.flags)) == ({}, (), ())
    assert "tempco_scale" not in found(result)


def test_the_other_polarity_keeps_its_own_model():
    result = reduced(Made().level("gravity", 1.0).level("gravity", -1.0))
    assert decisions(result) == {"down_1g": ("up_1g", "keep")}
    assert any("at the other polarity" in flag for flag in texts(result.flags))


def test_a_ramp_too_short_decides_nothing_and_leaves_the_unit_incomplete():
    made = Made().level("gravity", 1.0).point("source", 1.0).ramp("source", 1.0, 10.0, 13.0, 1000.0)
    result = reduced(made)
    assert result.left_out == ("src_1g",)
    assert result.verdict == "INCOMPLETE"
    assert "src_1g:insufficient_temperature_span" in texts(result.flags)
    assert decisions(result) == {"src_1g": ("up_1g", "invalid")}


def test_a_slope_that_is_nothing_gives_no_decision():
    result = reduced(four_levels(alpha=0.0, beta=0.0))
    assert {decision for _, decision in decisions(result).values()} == {"invalid"}
    assert any("less than three times its uncertainty" in flag for flag in texts(result.flags))
    assert "deviation/raw@src_12g" not in found(result)


# The input


def test_points_at_rest_tell_the_drift_of_the_source_and_the_budget_holds_it():
    made = Made(drift=8e-6).level("source", 1.0)
    result = reduced(made, drift_limit=20e-6)
    drift = found(result)["rate/drift@src_1g"]
    assert drift.value == pytest.approx(8e-6 * (RAMP_S + POINT_S) / 3600, rel=0.03)
    assert drift.u < 0.1e-6
    slope = found(result)["rate/relative_temperature_coefficient@src_1g"]
    assert abs(slope.value - ALPHA - BETA / rate(1.0, 25.0)) < 1.5 * slope.u
    assert slope.budget[0].source == "source: drift during the ramp"


def test_an_accelerometer_may_have_drifted_during_its_ramp_alone_and_the_rate_has_its_part_of_it():
    result = reduced(Made(drift=8e-6).level("gravity", 1.0), reference_temperature_c=5.0)
    (level,) = result.detail.levels
    assert level.drift_u_per_h == pytest.approx(abs(level.drift.change) / np.sqrt(3) / (RAMP_S / 3600), rel=0.01)
    slope, at_5 = (
        {line.source: line.u for line in found(result)[f"{name}@up_1g"].budget}["accelerometer: drift during the ramp"]
        for name in ("rate/temperature_coefficient", "rate")
    )
    assert at_5 == pytest.approx(20.0 * slope, rel=0.01), "5 °C is 20 °C from the middle of the ramp"


def test_a_drift_beyond_its_limit_makes_what_is_decided_marginal():
    made = Made(drift=8e-6).level("source", 1.0).level("source", 12.0)
    result = reduced(made, drift_limit=5e-6)
    assert [each.marginal for each in result.detail.compared] == [True]
    assert "src_1g:input_drifted" in texts(result.flags)
    assert "decision_marginal" in found(result)["deviation/normalised@src_12g"].flags
    assert not reduced(made, drift_limit=50e-6).detail.compared[0].drifted


@pytest.mark.parametrize(("drift_limit", "marginal"), [(5e-6, True), (50e-6, False)])
def test_a_drift_beyond_its_limit_makes_the_verdicts_on_the_run_marginal(drift_limit, marginal):
    result = reduced(Made(drift=8e-6).level("gravity", 1.0), drift_limit=drift_limit)
    assert ("up_1g:input_drifted" in texts(result.flags)) == marginal
    for quantity in ("rate/relative_temperature_coefficient", "rate/drift"):
        finding = found(result)[f"{quantity}@up_1g"]
        assert finding.judged(Limits(low=-1.0, high=1.0)).marginal == marginal


@pytest.mark.parametrize("own", [40e-6, 90e-6, 400e-6, -400e-6])
def test_an_accelerometer_that_drifts_more_than_is_stated_shows_it_beside_the_source(own):
    result = reduced(four_levels(own=own))
    slope = found(result)["rate/relative_temperature_coefficient@up_1g"]
    line = next(each for each in slope.budget if each.kind == OWN_TEMPERATURE)
    beyond = abs(own) > 2 * 60e-6
    assert ("up_1g:accelerometer_drift" in texts(result.flags)) == beyond
    assert line.u == pytest.approx(FOLLOWS * (abs(own) if beyond else 60e-6), rel=0.3)
    assert abs(slope.value - ALPHA - BETA / rate(1.0, 25.0)) < 2 * slope.u
    alone = reduced(Made(own=own).level("gravity", 1.0))
    assert "up_1g:accelerometer_drift" not in texts(alone.flags), "without a source nothing tells"


def test_the_certificate_counts_where_the_points_find_less():
    stated = replace(BENCH, sources={"source": SourceRecord(0.0, 0.0, 1e-6 / 3600)})
    made = Made().level("source", 1.0).level("source", 12.0)
    slope = found(reduced(made, stated))["rate/relative_temperature_coefficient@src_12g"]
    hours_per_c = RAMP_S / 3600 / (HIGH_C - LOW_C)
    of_source = {line.source: line.u for line in slope.budget}
    assert of_source["source: drift during the ramp"] == pytest.approx(1e-6 * hours_per_c, rel=0.01)


@pytest.mark.parametrize(("found_per_h", "assumed_per_h"), [(1.5e-6, 1e-6), (3e-6, 3e-6)])
def test_the_points_overrule_the_certificate_where_they_find_more_than_its_expanded_uncertainty(
    found_per_h, assumed_per_h
):
    stated = replace(BENCH, sources={"source": SourceRecord(0.0, 0.0, 1e-6 / 3600)})
    (level,) = reduced(Made(drift=found_per_h).level("source", 1.0), stated).detail.levels
    assert level.drift_u_per_h == pytest.approx(assumed_per_h, rel=0.03)


def test_levels_of_gravity_share_what_the_accelerometer_does_when_it_follows_the_chamber():
    made = four_levels()
    for acquisition in made.acquisitions:
        board_c = acquisition.temperatures_c["board"]
        acquisition.temperatures_c["unit"] = 65.0 + 5e-4 * (board_c - LOW_C)
    results = found(reduced(made))
    own = {
        name: sum("its own temperature" in line.source for line in results[f"deviation/normalised@{name}"].budget)
        for name in ("skew", "src_12g")
    }
    assert own == {"skew": 0, "src_12g": 1}
    slope = results["rate/relative_temperature_coefficient@skew"]
    assert {line.shared for line in slope.budget} >= {"a.accelerometer"}


def test_a_source_drifts_while_levels_of_gravity_are_measured():
    stated = replace(BENCH, sources={"source": SourceRecord(0.0, 0.0, 1e-6 / 3600)})
    alone, after = Made().level("source", 1.0), Made().level("gravity", 1.0).level("source", 1.0)
    drifted = []
    for made in (alone, after):
        rate = found(reduced(made, stated))["rate@src_1g"]
        (line,) = (line for line in rate.budget if line.source == "source: drift since the run began")
        drifted.append(line.u / rate.value)
    level_h = (RAMP_S + 2 * POINT_S) / 3600
    assert drifted[1] - drifted[0] == pytest.approx(1e-6 * level_h, rel=0.02)


def test_a_level_without_points_of_its_own_takes_the_drift_that_the_source_showed_at_another():
    made = Made(drift=8e-6).level("source", 1.0).ramp("source", 12.0).point("source", 1.0)
    result = reduced(made, drift_limit=5e-6)
    assert result.detail.levels[1].drift == result.detail.levels[0].drift
    assert result.detail.levels[0].drift.hours == pytest.approx((2 * RAMP_S + 2 * POINT_S) / 3600, rel=0.01)


def test_an_accelerometer_off_its_temperature_is_left_out_and_most_of_a_run_so_is_told():
    made = Made(held_c=66.0).level("gravity", 1.0)
    result = reduced(made)
    assert "up_1g" in result.left_out
    assert any(flag.endswith("samples: accelerometer_temperature") for flag in texts(result.flags))
    assert reduced(made, accelerometer_c=None).left_out == ()


def test_a_source_that_counts_at_zero_is_told():
    made = Made().level("source", 1.0).point("source", 0.0)
    still = replace(made.acquisitions[0], sources_a={"source": 0.0}, step="steps/acquire#9")
    made.acquisitions.append(still)
    result = reduced(made)
    assert "still connected?" in flag_in_words(flag_of(result.flags, "steps/acquire#9: not_zero"))


def test_a_point_that_was_to_become_stable_and_did_not_is_told():
    made = Made().level("source", 1.0)
    made.acquisitions[0] = replace(made.acquisitions[0], over_s=60.0, stable=frozenset())
    assert "steps/acquire#1: unstable" in texts(reduced(made).flags)


def test_a_rate_that_does_not_go_with_its_level_is_told():
    made = Made().level("gravity", 1.0).level("source", 12.0)
    wrong = [replace(each, sources_a={"source": 6 * K1}) if each.input == "source" else each
             for each in made.acquisitions]  # fmt: skip
    made.acquisitions[:] = wrong
    assert any(flag.endswith(":out_of_proportion") for flag in texts(reduced(made).flags))


def test_what_is_not_known_of_the_bench_is_told():
    result = reduced(Made().level("source", 1.0), replace(BENCH, sources={}))
    assert "source:not_certified" in texts(result.flags)
    blind = reduced(Made().level("gravity", 1.0), unit=replace(UNIT, converter=""))
    assert "converter:no_thermometer" in texts(blind.flags)
    assert blind.left_out == ("up_1g",)


# Readings


def test_lost_pulses_spoil_one_gate_and_no_line():
    made = Made().level("gravity", 1.0)
    ramp = made.acquisitions[1]
    broken = ramp.counts["x"].positive.copy()
    broken[2000:] = (broken[2000:] - 5000) % 2**24
    made.acquisitions[1] = replace(ramp, counts={"x": replace(ramp.counts["x"], positive=broken)})
    result = reduced(made)
    assert "up_1g: 1 samples: outlier" in texts(result.flags)
    slope = found(result)["rate/temperature_coefficient@up_1g"]
    assert abs(slope.value - S * K1 * ALPHA - BETA) < 1e-4


def test_a_counter_that_begins_anew_in_a_run_costs_one_gate():
    made = Made().level("gravity", 1.0)
    ramp = made.acquisitions[1]
    counts, later = ramp.counts["x"], np.arange(len(ramp.counts["x"].tick)) >= 2000
    tick = np.where(later, counts.tick - counts.tick[2000], counts.tick)
    positive = np.where(later, (counts.positive - counts.positive[2000]) % 2**24, counts.positive)
    made.acquisitions[1] = replace(ramp, counts={"x": replace(counts, tick=tick, positive=positive, restarts=1)})
    slope = found(reduced(made))["rate/temperature_coefficient@up_1g"]
    assert abs(slope.value - S * K1 * ALPHA - BETA) < 2e-4


def test_arrivals_in_portions_do_not_change_the_times_of_latches():
    """Latches every 5 ms behind a serial adapter, which hands over what it has every 16 ms."""
    made = Made().ramp("gravity", 1.0, seconds=20.0)
    (ramp,) = made.acquisitions
    number = np.arange(4000)
    counts = replace(
        ramp.counts["x"], sequence=number, tick=5000 * number, positive=50 * number, negative=0 * number,
        host_s=ramp.begin_s + np.ceil(0.005 * number / 0.016) * 0.016,
    )  # fmt: skip
    record = read_out(replace(ramp, counts={"x": counts}), UNIT, 1.0)
    rates_pps = np.diff(record.positive) / np.diff(record.time_s)
    assert len(rates_pps) > 10
    assert np.abs(rates_pps / 10_000 - 1).max() < 1e-9


def test_up_and_down_are_one_run_and_the_gap_between_them_is_no_gate():
    made = Made().point("gravity", 1.0).ramp("gravity", 1.0).ramp("gravity", 1.0, HIGH_C, LOW_C).point("gravity", 1.0)
    result = reduced(made)
    (level,) = result.detail.levels
    assert level.run.excluded["gap"] == 1
    assert abs(level.scatter.drift_h_per_c) < 1e-3, "what drifts evenly cancels between up and down"
    assert not any("gap" in flag for flag in texts(result.flags))


def test_an_empty_acquisition_says_nothing():
    made = Made().level("gravity", 1.0)
    ramp = made.acquisitions[1]
    counts = ramp.counts["x"]
    empty = replace(counts, sequence=counts.sequence[:0], tick=counts.tick[:0], positive=counts.positive[:0],
                    negative=counts.negative[:0], host_s=counts.host_s[:0])  # fmt: skip
    made.acquisitions[1] = replace(ramp, counts={"x": empty})
    result = reduced(made)
    assert result.verdict == "INCOMPLETE"
    assert "up_1g:invalid" in texts(result.flags)


# How well a line is known


def gates_of(rng, scatter_pps=0.0, count=600, seconds=10.0, cycle_pps=0.0):
    """Gates that share latches, on a ramp from 0 °C to 30 °C; each latch leaves up to one pulse uncounted.

    Beside that a gate scatters, and follows a cycle of 87 s that begins anywhere.
    """
    left = rng.uniform(0, 1, count + 1)
    edges_s = np.arange(count + 1) * seconds
    middle_s = (edges_s[1:] + edges_s[:-1]) / 2
    cycle = cycle_pps * np.sin(2 * np.pi * (middle_s / 87.0 + rng.uniform()))
    rest_pps = scatter_pps * rng.standard_normal(count) + cycle
    pulses = (10_000.0 + rest_pps) * seconds + np.diff(left)
    return Gates(middle_s, np.full(count, seconds), pulses, np.zeros(count), np.linspace(0, 30, count),
                 np.full(count, 65.0))  # fmt: skip


@pytest.mark.lengthy
@pytest.mark.parametrize(("count", "scatter_pps", "cycle_pps", "least", "most"), [
    (150, 0.0, 0.0, 0.85, 1.15), (150, 0.005, 0.0, 0.85, 1.15), (600, 0.02, 0.0, 0.85, 1.15),
    (150, 0.0, 0.03, 0.6, 1.15),  # a chamber's limit cycle, of which stretches of a minute make too much
])  # fmt: skip
def test_the_uncertainty_of_a_line_is_what_lines_scatter_by(count, scatter_pps, cycle_pps, least, most):
    """Where nothing but counts scatters, looking for more finds next to nothing."""
    rng = np.random.default_rng(1)
    slopes, rates, reported = [], [], []
    for _ in range(150):
        gates = gates_of(rng, scatter_pps, count, cycle_pps=cycle_pps)
        slope, offset = np.polyfit(gates.converter_c - 25, gates.rate, 1)
        slopes.append(slope)
        rates.append(offset)
        scatter = line_scatter(gates, 25.0)
        reported.append((np.hypot(scatter.counting_slope, scatter.scatter_slope),
                     np.hypot(scatter.counting_rate, scatter.scatter_rate)))  # fmt: skip
    u_slope, u_rate = np.sqrt(np.mean(np.square(reported), axis=0))
    assert least < np.std(slopes) / u_slope < most
    assert least < np.std(rates) / u_rate < most


def test_residuals_of_the_gates_would_tell_ten_times_too_much_where_only_counts_scatter():
    gates = gates_of(np.random.default_rng(2))
    residuals = np.std(gates.rate - np.polyval(np.polyfit(gates.converter_c, gates.rate, 1), gates.converter_c))
    naive = residuals / np.sqrt(np.sum((gates.converter_c - gates.converter_c.mean()) ** 2))
    assert naive > 10 * line_scatter(gates, 25.0).counting_slope


def cycling(rng, count=150, seconds=10.0, cycle_c=0.024, period_s=87.0, lag_s=20.0, volts_per_c=5e-5):
    """Gates of a converter that makes volts, with what its noiseless output is over its noiseless thermometer.

    The thermometer tells the chamber's limit cycle later and smaller; it scatters, and so does the voltmeter.
    """
    time_s = (np.arange(count) + 0.5) * seconds
    phase, behind = 2 * np.pi * (time_s / period_s + rng.uniform()), 2 * np.pi * lag_s / period_s
    cycle_c *= np.sinc(seconds / period_s)
    true_c = 20 + time_s / 120.0 + cycle_c * np.sin(phase)
    told_c = 20 + (time_s - lag_s) / 120.0 + cycle_c * np.sin(phase - np.arctan(behind)) / np.hypot(1, behind)
    (slope, rate) = np.polyfit(told_c - 25, volts_per_c * true_c, 1)
    volts = volts_per_c * true_c + 1e-7 * rng.standard_normal(count)
    gates = Gates(
        time_s, np.full(count, seconds), volts * seconds, np.zeros(count),
        told_c + 1.6e-3 * rng.standard_normal(count), np.full(count, 65.0), np.zeros(count),
    )  # fmt: skip
    return gates, (slope, rate)


def errors_over_u(rng):
    for _ in range(150):
        gates, true = cycling(rng)
        found = np.polyfit(gates.converter_c - 25, gates.rate, 1)
        scatter = line_scatter(gates, 25.0)
        yield (found - true) / (scatter.scatter_slope, scatter.scatter_rate)


def test_what_a_thermometer_tells_of_a_cycle_later_is_no_scatter(monkeypatch):
    ratios = np.sqrt(np.mean(np.square(list(errors_over_u(np.random.default_rng(4)))), axis=0))
    assert ratios == pytest.approx(1.0, abs=0.15)
    monkeypatch.setattr(channel_scatter, "own_scatter", channel_scatter.excess)
    taken_for_scatter = np.square(list(errors_over_u(np.random.default_rng(4))))
    assert np.max(np.sqrt(np.mean(taken_for_scatter, axis=0))) < 0.5


def test_a_run_of_a_few_gates_has_no_stretches():
    with pytest.raises(NotDetermined):
        line_scatter(gates_of(np.random.default_rng(3), count=40), 25.0)


def test_a_head_that_turns_gives_its_own_level():
    head = replace(BENCH, axes={"head": AxisRecord()})
    made = Made().level("gravity", 1.0)
    made.acquisitions[:] = [replace(each, mount=Mount(), angles_deg={"head": 90.0}) for each in made.acquisitions]
    assert [level.name for level in reduced(made, head).detail.levels] == ["up_1g"]


# What a user of the channel gets


def at_reference(result, channel, level_g, board_c, **converter):
    """The rate of a level at a temperature, referred to the reference temperature by the calibration."""
    known = next(each for each in result.compensations if each.channel == channel)
    (value,), _ = known.apply(np.array([rate(level_g, board_c, **converter)]), np.array([board_c]))
    return value


def test_one_slope_serves_all_levels_that_share_it(usual):
    known, to_g = usual.compensations
    assert (to_g.channel, to_g.value_unit) == ("x", "g")
    assert (known.channel, known.serves) == ("x@up_1g", ("up_1g", "skew", "src_1g", "src_12g"))
    assert known.valid_c == pytest.approx((LOW_C, HIGH_C), abs=0.2)
    for level_g in (0.577, 1.0, 12.0):
        away = rate(level_g, 40.0) - rate(level_g, 25.0)
        assert abs(at_reference(usual, "x@up_1g", level_g, 40.0) - rate(level_g, 25.0)) < 0.05 * abs(away)


def test_a_level_that_keeps_its_own_slope_has_an_entry_of_its_own():
    same = {"alpha": 0.0, "beta": 0.3}
    result = reduced(four_levels(**same))
    kept = {each.channel: each.serves for each in result.compensations}
    assert kept["x@src_12g"] == ("src_12g",)
    assert at_reference(result, "x@src_12g", 12.0, 40.0, **same) == pytest.approx(rate(12.0, 25.0, **same), abs=0.05)
    by_another = at_reference(result, "x@up_1g", 12.0, 40.0, **same)
    assert abs(by_another - rate(12.0, 25.0, **same)) > 10


def test_on_the_raw_basis_the_slope_is_taken_off():
    same = {"alpha": 0.0, "beta": 0.3}
    result = reduced(four_levels(**same), compare_basis="raw")
    known, _ = result.compensations
    assert known.serves == ("up_1g", "skew", "src_1g", "src_12g")
    assert at_reference(result, "x@up_1g", 12.0, 40.0, **same) == pytest.approx(rate(12.0, 25.0, **same), abs=0.05)


# An ammeter in the cable of the source

METERED = replace(UNIT, ammeter="dmm")
BOTH = replace(BENCH, sources=BENCH.sources | {"dmm": SourceRecord(4e-6, 2e-9, 0.0)})


def with_ammeter(made: Made, wrong: float = 0.0, unread: float | None = None) -> Made:
    """The same, of a source that gives so much more than it says; at one level the ammeter reads nothing."""
    for number, each in enumerate(made.acquisitions):
        if each.input == "source":
            told_a = each.sources_a["source"]
            at_s = np.arange(each.begin_s, each.end_s, 4.0)
            noise = 1e-9 * np.sin(np.arange(len(at_s)) * 2.4)
            read = Currents(at_s, told_a * (1 + wrong) + noise)
            is_unread = unread is not None and told_a == unread * K1
            made.acquisitions[number] = replace(each, currents={} if is_unread else {"dmm": read})
    return made


def two_levels(**converter) -> Made:
    made = Made(**converter)
    return made.level("source", 1.0).level("source", 12.0).point("source", 0.0)


def test_an_ammeter_that_is_not_believed_changes_no_result_and_is_told_beside():
    plain, beside = found(reduced(two_levels())), found(reduced(with_ammeter(two_levels(), 5e-6), BOTH, METERED))
    extra = {f"{quantity}@src_{level}g" for quantity in ("current", "current/deviation") for level in (1, 12)}
    assert beside.keys() - plain.keys() == extra
    assert all(beside[name] == finding for name, finding in plain.items())
    assert beside["current/deviation@src_1g"].value == pytest.approx(5e-6, abs=1e-7)


@pytest.mark.parametrize(("wrong", "reported"), [(50e-6, False), (80e-6, True), (-80e-6, True)])
def test_source_and_ammeter_that_contradict_their_certificates_are_told(wrong, reported):
    result = reduced(with_ammeter(two_levels(), wrong), BOTH, METERED)
    assert ("src_12g:source_and_ammeter_differ" in texts(result.flags)) is reported


def test_a_level_that_a_believed_ammeter_has_not_read_has_no_result():
    result = reduced(with_ammeter(two_levels(), unread=12.0), BOTH, METERED, current_from="meter")
    missing = flag_of(result.flags, "src_12g:ammeter_missing")
    assert flag_in_words(missing).endswith("has not read its current.")
    assert [name for name in found(result) if name.endswith("src_12g")] == []
    assert "src_12g" in result.left_out
    rate_1g = found(result)["rate@src_1g"]
    assert np.isfinite([rate_1g.value, rate_1g.u]).all()
    zero = found(result)["zero@src_0g"]
    assert np.isfinite([zero.value, zero.u]).all()
    unread = reduced(with_ammeter(two_levels(), unread=0.0), BOTH, METERED, current_from="meter")
    assert "zero@src_0g" not in found(unread), "what fed it is not known"


def test_an_ammeter_without_a_certificate_is_told():
    result = reduced(with_ammeter(two_levels()), BENCH, METERED, current_from="meter")
    assert "dmm:not_certified" in texts(result.flags)
    by_meter = reduced(with_ammeter(two_levels()), BOTH, METERED, current_from="meter")
    assert "dmm:not_certified" not in texts(by_meter.flags)


def test_without_an_ammeter_the_source_is_believed_whatever_is_asked():
    assert found(reduced(two_levels(), current_from="meter")) == found(reduced(two_levels()))


def test_a_ramp_on_which_the_converter_stays_at_one_temperature_tells_no_drift():
    at_s = np.arange(100.0)
    still = Gates(at_s, np.ones(100), at_s, 0 * at_s, np.full(100, 25.0), np.full(100, 65.0))
    assert np.isnan(Metered(at_s, np.full(100, 1e-3)).change_per_c(still)).all()


@pytest.mark.parametrize(
    ("factor", "flags"), [(1.1, []), (-1.0, ["K1:sign_unlike_nominal"]), (0.1, ["K1:size_unlike_nominal"])]
)
def test_a_channel_of_another_sign_or_size_than_the_bench_file_states_is_flagged(factor, flags):
    stated = replace(UNIT, nominal_per_g=factor * rate(1.0, 25.0))
    result = reduced(four_levels(), unit=stated)
    assert [flag for flag in texts(result.flags) if flag.startswith("K1:")] == flags


# To specific force


STATED = {"bias_g": 1e-3, "bias_u_g": 2e-5, "quadratic_g_per_g2": 2e-4, "quadratic_u_g_per_g2": 4e-5}


def to_force(made: Made, **settings: Any) -> Compensation:
    return next(each for each in reduced(made, **(STATED | settings)).compensations if each.value_unit == "g")


def force_of(known: Compensation, rate_pps: float, board_c: float) -> float:
    """Specific force of a rate by an entry of a calibration file, which is solved for v at a time."""
    record = CountRecord(np.array([0.0, 1e6]), np.full(2, board_c), {"x": np.array([rate_pps * 1e6])})
    return float(specific_forces(record, {"x": known})["x"].force_g[0])


@pytest.mark.parametrize("board_c", [15.0, 40.0])
@pytest.mark.parametrize("level_g", [0.3, 1.0, 6.0, 12.0])
def test_a_rate_at_any_level_and_temperature_is_a_specific_force(level_g, board_c):
    """The drift is much the same at all levels here: in proportion to them it would be 3 mg wrong at 12 g."""
    same = {"alpha": 1e-5, "beta": 0.3}
    known = to_force(four_levels(**same), bias_g=0.0, quadratic_g_per_g2=0.0)
    found_g = force_of(known, float(rate(level_g, board_c, **same)), board_c)
    # The rate has a zero beside its proportional part, which is not in the stated bias of 0.
    zero_g = float(rate(0.0, 25.0)) / (S * K1)
    assert found_g == pytest.approx(level_g * (1 - zero_g) + zero_g, rel=1e-5, abs=1e-5)


def test_bias_and_nonlinearity_that_are_stated_are_taken_out():
    known = to_force(four_levels())
    scale = known.scale
    up_pps = S * K1 * 1.0 + float(rate(0.0, 25.0))
    assert scale.coefficients[0] == pytest.approx(up_pps / (1 + 1e-3 + 2e-4), rel=2e-6)
    assert known.bias.value == pytest.approx(1.2e-3)
    for true_g in (-0.5, 0.0, 1.0, 3.0):
        counted = scale.coefficients[0] * (true_g + 1e-3 + 2e-4 * true_g**2)
        assert force_of(known, counted, 25.0) == pytest.approx(true_g, abs=1e-9)


EXACT = replace(BENCH, time_base_u=0.0, thermometers_u={"board": (0.0, 0.0)}, level_u_deg=0.0)


@pytest.mark.parametrize(
    ("bench", "known_to", "gain_u"), [(BENCH, 1.0, 1e-3), (EXACT, 1e-6, 0.0)], ids=["stated", "by the slopes"]
)
def test_the_errors_of_the_entry_are_those_of_what_it_was_made_from(bench, known_to, gain_u):
    """Drawn: rate, bias, nonlinearity and both coefficients; each time the equation is solved anew."""
    stated = STATED | {name: STATED[name] * known_to for name in ("bias_u_g", "quadratic_u_g_per_g2")}
    result = reduced(four_levels(), bench, **stated)
    known = next(each for each in result.compensations if each.value_unit == "g")
    results, rng = found(result), np.random.default_rng(7)
    up, alpha, beta = (results[name] for name in ("rate@up_1g", "tempco_scale", "tempco_offset"))
    detail = result.detail.levels
    slopes_u = np.array([level.known_run.u_slope_per_c for level in detail])
    rates = np.array([level.run.rate for level in detail])
    weights = 1 / slopes_u**2
    of_line = np.linalg.inv(np.stack([np.ones(4), rates]) * weights @ np.stack([np.ones(4), rates], axis=1))
    correlated = of_line[0, 1] / np.sqrt(of_line[0, 0] * of_line[1, 1])
    # The gain of the thermometer changes both coefficients alike.
    of_slopes_u = [np.sqrt(each.u**2 - (gain_u * each.value) ** 2) for each in (beta, alpha)]
    together = rng.multivariate_normal([0, 0], [[1, correlated], [correlated, 1]], 4000) * of_slopes_u
    together += gain_u * rng.standard_normal((4000, 1)) * [beta.value, alpha.value]
    drawn = rng.standard_normal((4000, 3)) * [up.u, stated["bias_u_g"], stated["quadratic_u_g_per_g2"]]
    counted, away_c = 70_000.0, 12.0
    forces = []
    for (d_rate, d_bias, d_quadratic), (d_beta, d_alpha) in zip(drawn, together, strict=True):
        bias, quadratic = STATED["bias_g"] + d_bias, STATED["quadratic_g_per_g2"] + d_quadratic
        k1 = (up.value + d_rate) / (1 + bias + quadratic)
        referred = (counted - (beta.value + d_beta) * away_c) / (1 + (alpha.value + d_alpha) * away_c) / k1 - bias
        forces.append((np.sqrt(1 + 4 * quadratic * referred) - 1) / (2 * quadratic))
    record = CountRecord(np.array([0.0, 1e6]), np.full(2, 25.0 + away_c), {"x": np.array([counted * 1e6])})
    force = specific_forces(record, {"x": known})["x"]
    assert force.force_g[0] == pytest.approx(np.mean(forces), abs=4 * np.std(forces) / 60)
    assert force.u_g()[0] == pytest.approx(np.std(forces), rel=0.05)


def test_without_the_line_through_all_slopes_there_is_no_specific_force():
    alone = reduced(Made().level("gravity", 1.0)).compensations
    assert [each.channel for each in alone] == ["x@up_1g"]
    by_source = reduced(two_levels(), compare_basis="normalised").compensations
    assert all(each.value_unit != "g" for each in by_source)
