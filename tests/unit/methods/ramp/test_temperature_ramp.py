"""The dynamic temperature test on counts that were made from known constants."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bench.figures.words import where
from bench.methods.ramp.method import TEMPERATURE_RAMP
from bench.methods.ramp.reduction.run import reduce
from bench.metrology.acquisition import Acquisition, Counts
from bench.metrology.bench_uncertainty import AxisRecord, BenchRecord
from bench.metrology.results.finding import Finding, UnitResult
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.report.flag_words import flag_in_words
from tests.support.flags import texts
from tests.support.m4_cases import lagging_c

LOW_C, HIGH_C, LEG_S = 10.0, 60.0, 2400
K1, K1_SLOPE, MISALIGNMENT = 11_300.0, -58e-6, 3e-4
SETTINGS = TEMPERATURE_RAMP.settings.model_validate({}).model_dump()
UNIT = UnitUnderTest("a", "QF-7", "x", 0.0, "unit_temperature")
BENCH = BenchRecord(
    gravity_mps2=9.8, gravity_u_mps2=0.0, axes={"head": AxisRecord()}, x=(1.0, 0.0, 0.0), z=(0.0, 0.0, 1.0),
    level_deg=0.0, level_u_deg=0.0, time_base_u=0.0, thermometers_u={"unit_temperature": (0.3, 1e-3)},
)  # fmt: skip
Bias = Callable[[np.ndarray, int, bool], np.ndarray]


def straight(temperature_c, _cycle, _rising):
    return 8e-4 + 12e-6 * (temperature_c - 20)


def counts_of(rate_pps, at_s):
    positive = np.floor(np.cumsum(rate_pps) + 0.618 * at_s[0] / LEG_S).astype(np.int64)  # no leg like another
    number = np.arange(len(at_s))
    return Counts(
        sequence=number, tick=1_000_000 * number % 2**32, positive=(16_777_000 + positive) % 2**24,
        negative=np.zeros_like(positive), host_s=at_s, tick_bits=32, counter_bits=24, tick_period_s=1e-6,
        max_rate_pps=256e3, lost=0, restarts=0,
    )  # fmt: skip


def leg(position_deg, cycle, rising, begin_s, bias: Bias, temperature_c=None) -> Acquisition:
    """One leg of a unit that is as warm as the set point, or has temperatures (LEG_S,) of its own."""
    at_s = begin_s + np.arange(LEG_S, dtype=float)
    from_c, to_c = (LOW_C, HIGH_C) if rising else (HIGH_C, LOW_C)
    temperature_c = np.linspace(from_c, to_c, LEG_S) if temperature_c is None else temperature_c
    angle_rad = np.radians(position_deg)
    scale = K1 * (1 + K1_SLOPE * (temperature_c - 20))
    force_g = np.sin(angle_rad) + MISALIGNMENT * np.cos(angle_rad) + bias(temperature_c, cycle, rising)
    return Acquisition(
        step=f"steps/position={position_deg:g}/cycle={cycle}/end={to_c:g}/acquire", group="", begin_s=begin_s,
        end_s=begin_s + LEG_S, loops={"position": position_deg, "cycle": cycle, "end": to_c},
        angles_deg={"head": position_deg},
        set_from_c=from_c, set_c=to_c, counts={"x": counts_of(scale * force_g, at_s)},
        temperatures_c={"unit_temperature": temperature_c}, temperatures_at_s={"unit_temperature": at_s},
    )  # fmt: skip


def run(bias: Bias = straight, *, positions=(1.0, 91.0), cycles=2) -> list[Acquisition]:
    legs = [(at, cycle, rising) for at in positions for cycle in range(1, cycles + 1) for rising in (True, False)]
    return [leg(*which, number * LEG_S, bias) for number, which in enumerate(legs)]


def reduced(acquisitions, **settings: Any) -> UnitResult:
    (result,) = reduce(RunData("ramp", (UNIT,), tuple(acquisitions), BENCH), SETTINGS | settings)
    return result


def found(result: UnitResult) -> dict[str, Finding]:
    return {finding.quantity: finding for finding in result.findings}


@pytest.fixture(scope="module")
def good() -> UnitResult:
    return reduced(run())


def test_a_straight_bias_is_found(good):
    findings = found(good)
    assert findings["K0/temperature_coefficient"].value == pytest.approx(12e-6, rel=2e-3)
    assert findings["K1/temperature_coefficient"].value == pytest.approx(-58e-6, rel=3e-3)
    assert findings["K0/jumps"].value == 0
    assert findings["K0/hysteresis"].value < 8e-6
    assert findings["K0/model_residual"].value < 15e-6, "no more than the resolution of a count in 10 s"
    assert findings["K0/model_residual"].value < 3 * findings["K0/model_residual"].u
    assert (texts(good.flags), good.left_out, good.verdict) == ((), (), "NOT JUDGED")


def test_every_result_is_there_in_its_unit(good):
    units = {quantity: finding.unit for quantity, finding in found(good).items()}
    assert units == TEMPERATURE_RAMP.stated


def test_every_finding_but_a_count_has_a_budget(good):
    assert {quantity for quantity, finding in found(good).items() if not finding.budget} == {"K0/jumps"}
    slope = found(good)["K0/temperature_coefficient"]
    lines = {line.source: line for line in slope.budget}
    assert lines["unit_temperature: gain"].u == pytest.approx(1e-3 * slope.value)
    assert lines["K1: misalignment in it"].u == pytest.approx(1e-3 * slope.value)
    assert all(line.u < slope.u + 1e-15 for line in slope.budget)


def test_models_are_the_line_of_the_bias_and_the_scale_factor(good):
    line, scale, dynamic = good.models
    assert (line.quantity, len(line.coefficients), line.dwells_used) == ("K0", 2, 4)
    assert line.powers_of_t[0] == pytest.approx(8e-4 + MISALIGNMENT - 12e-6 * 20, abs=8e-6)
    assert (scale.quantity, scale.dwells_used) == ("K1", 4)
    assert scale.coefficients[0] == pytest.approx(K1 * (1 + K1_SLOPE * 15), rel=4e-4), "but for the misalignment"
    assert (dynamic.quantity, dynamic.form) == ("K0/dynamic", "K0 = B0 + B1 T + Bd dT/dt")
    assert dynamic.constants["B1"].value == pytest.approx(12e-6, rel=2e-3)


def loop(temperature_c, cycle, rising):
    """A lens between rising and falling, 80 µg wide at 35 °C, and a second cycle that is 20 µg higher."""
    lens = 40e-6 * (1 - ((temperature_c - 35) / 25) ** 2)
    return straight(temperature_c, cycle, rising) + (lens if rising else -lens) + (20e-6 if cycle == 2 else 0.0)


def test_loop_and_change_between_cycles_are_found_where_they_are():
    findings = found(reduced(run(loop)))
    hysteresis, repeatability = findings["K0/hysteresis"], findings["K0/repeatability"]
    assert abs(hysteresis.value - 80e-6) < 3 * hysteresis.u < 9e-6
    assert abs(hysteresis.at["at_c"] - 35) < 8
    assert abs(repeatability.value - 20e-6) < 3 * repeatability.u
    assert repeatability.at["cycle"] == 2
    assert where(repeatability.at, {}).startswith("cycle 2, ")
    assert "lag" not in hysteresis.flags
    assert [line.type for line in hysteresis.budget][-1] == "alias"


def two_branches(temperature_c, cycle, _rising):
    """60 µg higher where the unit itself cools than where it warms, and 20 µg in the second cycle."""
    return straight(temperature_c, cycle, True) + np.where(np.gradient(temperature_c) < 0, 60e-6, 0.0) + cycle * 20e-6


def test_the_two_branches_of_a_turn_round_are_no_change_between_cycles():
    """The unit is 4 min behind the air: every leg but the first begins on the branch of the one before it."""
    ends_c = np.array([LOW_C, HIGH_C, LOW_C, HIGH_C, LOW_C])
    time_s = np.arange(4.0 * LEG_S)
    behind_c = lagging_c(time_s, np.interp(time_s, LEG_S * np.arange(5), ends_c), 240.0).reshape(4, LEG_S)
    assert np.argmin(behind_c[2]) > 100, "rising only after that"
    legs = [
        leg(at, 1 + k // 2, k % 2 == 0, k * LEG_S, two_branches, behind_c[k]) for at in (1.0, 91.0) for k in range(4)
    ]
    findings = found(reduced(legs))
    for quantity, true in (("K0/repeatability", 20e-6), ("K0/hysteresis", 60e-6)):
        finding = findings[quantity]
        assert abs(finding.value - true) < 2 * finding.u < 20e-6, quantity
        assert finding.interval.low <= true <= finding.interval.high, quantity


def test_a_jump_is_counted_and_told_with_its_place():
    def jumping(temperature_c, cycle, rising):
        return straight(temperature_c, cycle, rising) - 150e-6 * ((cycle == 2) & rising & (temperature_c > 40))

    result = reduced(run(jumping))
    findings = found(result)
    jump = findings["K0/jump"]
    assert findings["K0/jumps"].value == 1
    assert jump.value == pytest.approx(-150e-6, abs=4 * jump.u)
    assert findings["K0/largest_jump"].value == -jump.value
    assert where(jump.at, {}) == f"cycle 2, rising, at {jump.at['at_c']:.1f} °C"
    assert abs(jump.at["at_c"] - 40) < 0.5
    assert [curve.jumps_c for curve in result.detail] == [(), (), (jump.at["at_c"],), ()]
    assert found(reduced(run(jumping), jump_threshold_g=300e-6))["K0/jumps"].value == 0


def test_a_loop_that_is_a_lag_is_called_one():
    rate_c_per_s, lag_s = (HIGH_C - LOW_C) / LEG_S, 240.0

    def lagging(temperature_c, cycle, rising):
        return straight(temperature_c - (1 if rising else -1) * rate_c_per_s * lag_s, cycle, rising)

    findings = found(reduced(run(lagging)))
    assert findings["K0/hysteresis"].flags == ("lag",)
    assert findings["K0/lag"].value == pytest.approx(lag_s, rel=0.02)
    assert findings["K0/lag"].u == pytest.approx(lag_s**2 / LEG_S, rel=0.05)


def test_one_cycle_has_no_repeatability():
    assert set(TEMPERATURE_RAMP.quantities) - set(found(reduced(run(cycles=1)))) == {"K0/repeatability"}


@pytest.mark.parametrize(
    ("nominal_per_g", "flags", "words"),
    [(K1, (), ""), (-K1, ("K1:sign_unlike_nominal",), "K1: its sign is not that of the stated scale factor: "),
     (K1 / 9.80665, ("K1:size_unlike_nominal",), "K1: it is less than half or more than twice the stated ")],
)  # fmt: skip
def test_a_scale_factor_of_another_sign_or_size_than_the_bench_file_states_is_flagged(nominal_per_g, flags, words):
    unit = replace(UNIT, nominal_per_g=nominal_per_g)
    (result,) = reduce(RunData("ramp", (unit,), tuple(run()), BENCH), SETTINGS)
    assert texts(result.flags) == flags
    assert "".join(flag_in_words(flag) for flag in result.flags).startswith(words)


@pytest.mark.parametrize(("position", "missing"), [(1.0, "1 g"), (91.0, "0 g")])
def test_without_both_parts_nothing_is_found(position, missing):
    result = reduced(run(positions=(position,), cycles=1))
    assert (result.findings, result.verdict) == ((), "INCOMPLETE")
    assert texts(result.flags) == (f"{missing}: part_missing",)
    assert flag_in_words(result.flags[0]).startswith(f"{missing}: part: there is no leg at this input")


def test_an_acquisition_that_comes_back_is_no_leg():
    acquisitions = run()
    acquisitions[1] = replace(acquisitions[1], set_c=acquisitions[1].set_from_c)
    result = reduced(acquisitions)
    assert result.left_out == ("position=1/cycle=1/end=10",)
    assert texts(result.flags) == ("position=1/cycle=1/end=10: not_one_leg",)
    assert result.verdict == "INCOMPLETE"
    assert "its set point ends where it began" in flag_in_words(result.flags[0])


def test_another_angle_is_left_out_and_told():
    acquisitions = [*run(), *run(positions=(179.0,), cycles=1)]
    result = reduced(acquisitions)
    assert [flag.partition(": ")[2] for flag in texts(result.flags)] == ["another_angle"] * 2
    assert len(result.detail) == 4


def test_samples_without_counts_or_temperature_are_left_out_and_counted():
    acquisitions = run(loop)
    counts = acquisitions[0].counts["x"]
    kept = (np.arange(LEG_S) < 300) | (np.arange(LEG_S) >= 500)
    gap = replace(
        counts, sequence=counts.sequence[kept], tick=counts.tick[kept], positive=counts.positive[kept],
        negative=counts.negative[kept], host_s=counts.host_s[kept], lost=200,
    )  # fmt: skip
    acquisitions[0] = replace(acquisitions[0], counts={"x": gap})
    cold = acquisitions[2].temperatures_c["unit_temperature"][:600]
    acquisitions[2] = replace(
        acquisitions[2],
        temperatures_c={"unit_temperature": cold},
        temperatures_at_s={"unit_temperature": acquisitions[2].temperatures_at_s["unit_temperature"][:600]},
    )
    result = reduced(acquisitions)
    words = [flag_in_words(flag) for flag in result.flags]
    assert [text for text in words if text.startswith("21 samples are left out: fewer than half of its counter")]
    assert [text for text in words if text.startswith("179 samples are left out: no temperature of the unit (steps/")]
    assert sum("no temperature" in text for text in words) == 1, "an empty sample is told once"
    assert result.left_out == ("position=1/cycle=2/end=60",), "that leg has lost most of its samples"
    assert found(result)["K0/hysteresis"].value == pytest.approx(80e-6, abs=8e-6)


def test_a_counter_that_begins_anew_costs_one_sample():
    acquisitions = run()
    counts = acquisitions[3].counts["x"]
    later = np.arange(LEG_S) >= 1234
    anew = replace(counts, positive=np.where(later, counts.positive - counts.positive[1234], counts.positive),
                   tick=np.where(later, counts.tick - counts.tick[1234], counts.tick) % 2**32, restarts=1)  # fmt: skip
    acquisitions[3] = replace(acquisitions[3], counts={"x": anew})
    result = reduced(acquisitions)
    assert all(flag.split(": ")[1] == "1 samples" for flag in texts(result.flags))
    assert result.flags
    assert found(result)["K0/jumps"].value == 0
    assert found(result)["K0/temperature_coefficient"].value == pytest.approx(12e-6, rel=2e-3)


def test_a_broken_thermometer_is_left_out():
    acquisitions = run()
    broken = acquisitions[0].temperatures_c["unit_temperature"].copy()
    broken[700:705] = 850.0
    acquisitions[0] = replace(acquisitions[0], temperatures_c={"unit_temperature": broken})
    result = reduced(acquisitions)
    assert flag_in_words(result.flags[0]) == (
        "2 samples are left out: a temperature that a working thermometer cannot indicate."
    )
    assert found(result)["K0/temperature_coefficient"].value == pytest.approx(12e-6, rel=2e-3)


def test_one_temperature_determines_nothing():
    acquisitions = [replace(each, temperatures_c={"unit_temperature": np.full(LEG_S, 20.0)}) for each in run(cycles=1)]
    result = reduced(acquisitions)
    assert (result.findings, texts(result.flags)) == ((), ("K0:ill_conditioned",))
