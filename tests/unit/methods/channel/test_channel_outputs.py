"""A channel over temperature and input level on volts and codes that were made from known constants."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.methods.channel.method import CHANNEL_TEMPERATURE
from bench.methods.channel.reduction.run import reduce
from bench.metrology.acquisition import Acquisition, Codes, Mount, Voltages
from bench.metrology.bench_uncertainty import BenchRecord, SourceRecord
from bench.metrology.motion_records import SampleRecord
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.metrology.velocity import specific_forces
from tests.support.flags import texts

LOW_C, HIGH_C, RAMP_S, POINT_S = 10.0, 40.0, 4000.0, 600.0
K1, BEGIN_S = 1.13e-3, 1000.0  # A/g; when the first acquisition begins
ALPHA = 10e-6
SETTINGS = CHANNEL_TEMPERATURE.settings.model_validate({"threshold": "5 %", "accelerometer": "65 °C"}).model_dump()
VOLTS = UnitUnderTest(
    "a", "C-7", "", 0.0, "unit", converter="board", source="source", scale_a_per_g=K1, voltmeter="dvm"
)
CODES = replace(VOLTS, voltmeter=None, telemetry="x")
PER_G = {"V": 0.565, "code": 400_000.0}
BENCH = BenchRecord(
    gravity_mps2=9.8, gravity_u_mps2=0.0, axes={}, x=(1.0, 0.0, 0.0), z=(0.0, 0.0, 1.0), level_deg=0.0,
    level_u_deg=0.001, time_base_u=5e-7, thermometers_u={"board": (0.3, 1e-3)}, voltmeters_u={"dvm": (4e-6, 1e-6)},
    sources={"source": SourceRecord(20e-6, 10e-9, 0.0)},
)  # fmt: skip
LEVELS = (("gravity", 1.0), ("source", 1.0), ("source", 12.0))


def output(unit, level_g, board_c):
    per_g = PER_G[unit.output_unit]
    return per_g * (level_g * (1 + ALPHA * (board_c - 25)) + 2e-4 + 3e-7 * (board_c - 25))


def made(unit, noise=0.0, levels=LEVELS, seed=1, step=1.0):
    """Acquisitions one after the other: for each level a point, a ramp and a point; `noise` of a sample is in g."""
    draws, acquisitions, now_s = np.random.default_rng(seed), [], BEGIN_S
    for kind, level_g in levels:
        for from_c, to_c, seconds in ((LOW_C, LOW_C, POINT_S), (LOW_C, HIGH_C, RAMP_S), (LOW_C, LOW_C, POINT_S)):
            at_s = now_s + np.arange(0.5, seconds, 2.0 if unit.voltmeter else 0.5)
            board_c = np.linspace(from_c, to_c, len(at_s))
            values = output(unit, level_g, board_c)
            values = values + noise * PER_G[unit.output_unit] * draws.standard_normal(len(at_s))
            found = (
                {"voltages": {"dvm": Voltages(at_s, values)}}
                if unit.voltmeter
                else {"codes": {"x": codes(at_s, values, step)}}
            )
            by_source = kind == "source"
            acquisitions.append(Acquisition(
                step=f"steps/acquire#{len(acquisitions) + 1}", group="", loops={}, begin_s=now_s, end_s=now_s + seconds,
                angles_deg={}, set_from_c=from_c, set_c=to_c, counts={}, **found,
                temperatures_c={"board": board_c, "unit": np.full(len(at_s), 65.0)},
                temperatures_at_s={"board": at_s, "unit": at_s},
                mount=Mount() if by_source else Mount("up", 90.0), input="source" if by_source else "accelerometer",
                sources_a={"source": level_g * K1} if by_source else {},
            ))  # fmt: skip
            now_s += seconds + 10
    return acquisitions


def codes(at_s, values, step):
    number = np.arange(len(at_s))
    return Codes(
        sequence=number, tick=50_000 * number, values=step * np.rint(values / step), host_s=at_s, tick_bits=40,
        tick_period_s=1e-5, step=step, lost=0, dropped=0, invalid=0, stuck_after=None,
    )  # fmt: skip


def reduced(unit, acquisitions, **settings):
    (result,) = reduce(RunData("channel", (unit,), tuple(acquisitions), BENCH), SETTINGS | settings)
    return result


def found(result):
    return {finding.id.removeprefix("channel/a/"): finding for finding in result.findings}


def edited(acquisitions, index, **changes):
    return [replace(each, **changes) if at == index else each for at, each in enumerate(acquisitions)]


@pytest.mark.parametrize("unit", [VOLTS, CODES], ids=["volts", "codes"])
def test_each_level_has_its_line_in_the_unit_of_the_output(unit):
    result = reduced(unit, made(unit, noise=3e-6))
    results, of = found(result), unit.output_unit
    for name, level_g in (("up_1g", 1.0), ("src_1g", 1.0), ("src_12g", 12.0)):
        rate, slope = results[f"rate@{name}"], results[f"rate/temperature_coefficient@{name}"]
        assert (rate.unit, slope.unit) == (of, f"{of}/°C")
        assert rate.value == pytest.approx(output(unit, level_g, 25.0), rel=1e-6)
        assert slope.value == pytest.approx(PER_G[of] * (level_g * ALPHA + 3e-7), rel=5e-3)
    assert {each.level.name: each.comparison.decision for each in result.detail.compared} == {
        "src_1g": "share", "src_12g": "share",
    }  # fmt: skip
    assert {(each.output_unit, each.value_unit) for each in result.compensations} == {(of, of), (of, "g")}
    assert texts(result.flags) == result.left_out == ()


@pytest.mark.parametrize(
    ("unit", "averaged", "sampled"),
    [(VOLTS, True, ("instant", 0.0)), (CODES, True, ("mean", 1.0)), (CODES, False, ("instant", 1.0))],
)
@pytest.mark.parametrize("level_g", [-0.5, 0.3, 6.0])
def test_an_output_at_any_level_and_temperature_is_a_specific_force(unit, averaged, sampled, level_g):
    acquisitions = [
        replace(each, codes={name: replace(sent, averaged=averaged) for name, sent in each.codes.items()})
        for each in made(unit)
    ]
    zero_g = output(unit, 0.0, 25.0) / PER_G[unit.output_unit]
    result = reduced(unit, acquisitions, bias_g=zero_g, quadratic_g_per_g2=0.0)
    (known,) = (each for each in result.compensations if each.value_unit == "g")
    assert (known.force.sample, known.force.step) == sampled
    assert known.scale.unit == f"{unit.output_unit}/g"
    time_s = np.arange(3.0)
    sent = np.full(3, output(unit, level_g, 40.0))
    record = SampleRecord(time_s, np.full(3, 40.0), {known.channel: sent}, averaged=averaged)
    force = specific_forces(record, {known.channel: known})[known.channel]
    assert force.force_g == pytest.approx(np.full(2, level_g), abs=2e-5)


@pytest.mark.parametrize("unit", [VOLTS, CODES], ids=["volts", "codes"])
def test_the_uncertainty_of_a_slope_is_what_slopes_scatter_by(unit):
    ratios = []
    for seed in range(60):
        slope = found(reduced(unit, made(unit, 5e-6, LEVELS[:1], seed)))["rate/temperature_coefficient@up_1g"]
        u = next(line.u for line in slope.budget if line.source == "read-outs: scatter")
        ratios.append((slope.value - PER_G[unit.output_unit] * (ALPHA + 3e-7)) / u)
    assert 0.75 < np.sqrt(np.mean(np.square(ratios))) < 1.3


def test_coarse_codes_without_noise_are_as_uncertain_as_their_steps():
    """Of 120 codes that a ramp passes, and of the one that a point stands on."""
    fine, coarse = (found(reduced(CODES, made(CODES, step=step))) for step in (1.0, 200.0))
    steps = [next((line.u for line in each["rate/temperature_coefficient@up_1g"].budget if "steps" in line.source), 0.0)
             for each in (fine, coarse)]  # fmt: skip
    assert 0 < steps[0] < steps[1] / 50
    true = PER_G["code"] * (ALPHA + 3e-7)
    for each in (fine, coarse):
        slope = each["rate/temperature_coefficient@up_1g"]
        assert abs(slope.value - true) < 3 * slope.u


def test_noise_carries_a_ramp_across_the_steps():
    slope = found(reduced(CODES, made(CODES, noise=5e-6)))["rate/temperature_coefficient@up_1g"]
    assert not any("steps" in line.source for line in slope.budget)


def test_what_did_not_come_is_left_out_and_told():
    acquisitions = made(CODES, noise=3e-6)
    all_of_it = acquisitions[1].codes["x"]
    kept = np.ones(len(all_of_it.values), bool)
    kept[2000:2400] = False
    fewer = replace(
        all_of_it, **{name: getattr(all_of_it, name)[kept] for name in ("sequence", "tick", "values", "host_s")}
    )
    result = reduced(CODES, edited(acquisitions, 1, codes={"x": fewer}))
    assert "up_1g: 20 samples: too_few_codes" in texts(result.flags)
    assert result.left_out == ()


def test_a_unit_that_begins_anew_on_a_ramp_makes_its_level_invalid():
    acquisitions = made(CODES, noise=3e-6)
    of_ramp = acquisitions[1].codes["x"]
    anew = np.where(np.arange(len(of_ramp.tick)) < 4000, of_ramp.tick, of_ramp.tick - of_ramp.tick[4000])
    result = reduced(CODES, edited(acquisitions, 1, codes={"x": replace(of_ramp, tick=anew)}))
    assert "up_1g:invalid" in texts(result.flags)
    assert "up_1g" in result.left_out
    assert "rate@up_1g" not in found(result)


def test_a_voltmeter_that_read_nothing_for_a_while_leaves_the_rest():
    acquisitions = made(VOLTS, noise=3e-6)
    read = acquisitions[1].voltages["dvm"]
    kept = (np.arange(len(read.at_s)) < 500) | (np.arange(len(read.at_s)) >= 600)
    result = reduced(VOLTS, edited(acquisitions, 1, voltages={"dvm": Voltages(read.at_s[kept], read.values_v[kept])}))
    assert texts(result.flags) == ("up_1g: 19 samples: too_few_voltages",)


def test_temperatures_that_are_missing_or_impossible_or_of_an_accelerometer_that_is_not_held_are_told():
    acquisitions = made(VOLTS, noise=3e-6)
    at_s = acquisitions[1].temperatures_at_s["board"]
    board_c = acquisitions[1].temperatures_c["board"].copy()
    board_c[1001:1004] = 180.0
    unit_c = np.where(np.arange(len(at_s)) < 100, 64.0, 65.0)
    result = reduced(VOLTS, edited(acquisitions, 1, temperatures_c={"board": board_c, "unit": unit_c}))
    assert texts(result.flags) == ("up_1g: 2 samples: thermometer", "up_1g: 20 samples: accelerometer_temperature")
    without = reduced(VOLTS, edited(acquisitions, 1, temperatures_c={}, temperatures_at_s={}))
    assert "up_1g: 398 samples: missing" in texts(without.flags)
    assert "up_1g:invalid" in texts(without.flags)
