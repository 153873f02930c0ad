"""Range tests on counts that were made from known constants: what is found, judged, left out and told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.methods.rate_table.method import ACCELEROMETER_RANGE, GYRO_RANGE
from bench.methods.rate_table.reduction.range import reduce_accelerometer, reduce_gyro
from bench.methods.rate_table.reduction.range_findings import OTHERWISE_WARM
from bench.methods.rate_table.reduction.range_points import range_blocks
from bench.methods.rate_table.reduction.samples import PARTS_DOF
from bench.methods.rate_table.reduction.stated_scale import STATED_AT
from bench.methods.rate_table.reduction.temperatures import MeanTemperature, temperatures_c
from bench.metrology.bench_uncertainty import Drift
from bench.metrology.results.flag import Flag
from bench.report.flag_words import flag_in_words
from tests.support.flags import flag_of, texts
from tests.support.table_runs import BENCH, UNIT, at_rate, at_rest, data

GYRO = {"scale": "100 pulse/°", "full_scale": "400 °/s", "clip": "420 °/s"}
ACCELEROMETER = {"scale": "10000 pulse/s/g", "full_scale": "20 g", "clip": "21 g"}
RADIUS_M, K2, BIAS_G = 0.5, 1e-4, 2e-3
REST = [at_rest(50.0, angle) for angle in (0, 90, 180, 270)]


def gyro(*acquisitions, **settings):
    (unit,) = reduce_gyro(data(*acquisitions), GYRO_RANGE.settings.model_validate(GYRO | settings).model_dump())
    return unit


def accelerometer(*acquisitions, **settings):
    chosen = ACCELEROMETER_RANGE.settings.model_validate(ACCELEROMETER | settings).model_dump()
    (unit,) = reduce_accelerometer(data(*acquisitions), chosen)
    return unit


def values(unit, quantity):
    return [found.value for found in unit.findings if found.quantity == quantity]


def spun(rate_dps, scale=1.0):
    """An accelerometer that is pulled towards the axis, and bends."""
    pull_g = np.radians(rate_dps) ** 2 * RADIUS_M / 9.8
    return at_rate(rate_dps, scale * 1e4 * (BIAS_G + pull_g + K2 * pull_g**2))


def rested():
    return [at_rest(1e4 * BIAS_G, angle) for angle in (0, 90, 180, 270)]


def test_the_errors_of_a_gyro_are_those_of_its_scale():
    unit = gyro(*REST, at_rate(100, 50 + 10_005), at_rate(-100, 50 - 10_005), at_rate(400, 50 + 40_020))
    assert values(unit, "rest_rate") == pytest.approx([0.5], abs=2e-3)
    assert values(unit, "rate_error") == pytest.approx([0.05, -0.05, 0.2], abs=5e-3)
    assert values(unit, "rate_error/relative") == pytest.approx([5e-4, -5e-4, 5e-4], abs=5e-5)
    assert values(unit, "saturated_points") == [0]
    assert (texts(unit.flags), unit.left_out) == ((), ())


def test_the_scatter_of_few_readings_at_rest_is_told_together_with_that_within_them():
    (rest,) = [each for each in gyro(*REST, *REST).findings if each.quantity == "rest_rate"]
    few = len([*REST, *REST]) - 4  # bias, drift, and two of a harmonic
    assert [line.dof for line in rest.budget] == [few + len([*REST, *REST]) * PARTS_DOF]


@pytest.mark.parametrize(("angles", "share"), [((0, 90, 180, 270), 0.5), ((0, 0), 1.0)])
def test_a_wobble_of_the_axis_is_in_the_budget_of_the_output_at_rest(angles, share):
    rested = [at_rest(1e4 * BIAS_G, angle) for angle in angles]
    unit = accelerometer(*rested, spun(200), spun(-200), spun(250), spun(800))
    rest, *_ = unit.findings
    reported = {line.source: line.u for line in rest.budget}
    assert reported["axis: wobble"] == pytest.approx(share * np.radians(BENCH.head.wobble_u_deg))


def test_relative_to_the_full_scale_it_is_that_part_of_it():
    unit = gyro(*REST, at_rate(100, 50 + 10_005), linearity_basis="full_scale")
    assert values(unit, "rate_error/relative") == pytest.approx([0.05 / 400], abs=2e-5)


def test_a_bias_that_drifts_is_that_of_its_time():
    drifting = [at_rest(20.0), at_rate(100, 50 + 10_000), at_rate(-100, 80 - 10_000), at_rest(110.0)]
    assert values(gyro(*drifting), "rate_error") == pytest.approx([0.0, 0.0], abs=5e-3)


def test_a_table_that_did_not_turn_as_told_and_a_sensor_at_its_end_are_told():
    unit = gyro(*REST, at_rate(100, 10_050, rate_dps=101), at_rate(500, 42_000))
    off_rate, clipped = (each for each in unit.findings if each.quantity == "rate_error/relative")
    assert (off_rate.verdict, off_rate.flags) == ("INVALID", ("off_rate",))
    assert (clipped.verdict, clipped.flags) == (None, ("clipped",))
    assert values(unit, "saturated_points") == [1]
    assert unit.verdict == "INCOMPLETE"
    reported = [flag_in_words(flag) for flag in unit.flags]
    assert "did not turn at the commanded rate" in reported[0]
    assert "end of its range" in reported[1]


def test_without_a_reading_at_rest_nothing_is_known():
    unit = gyro(at_rate(100, 10_050))
    assert (unit.findings, texts(unit.flags), unit.left_out) == ((), ("rest_missing",), ("n=0/acquire",))
    assert "at rest" in flag_in_words(unit.flags[0])


def test_a_rest_at_one_angle_and_one_that_moves_are_told():
    unit = gyro(at_rest(50.0), at_rate(1.0, 150.0))
    assert texts(unit.flags) == ("rest_of_one_angle",)
    crept = at_rest(50.0)
    crept.positions["table"].position[:] += np.arange(3001)
    unit = gyro(crept, *REST)
    assert texts(unit.flags) == ("steps/n=0/acquire: not_at_rest",)
    assert "the table moved" in flag_in_words(unit.flags[0])


@pytest.mark.parametrize(("scale", "contradicted"), [(1.0, False), (1.0005, False), (1.005, True)])
def test_a_scale_factor_that_is_not_as_stated_shows_in_the_radius(scale, contradicted):
    """0.5 mm of 500 mm is 1000 ppm, which three times may be by chance."""
    runs = data(*rested(), *[spun(rate, scale) for rate in (200.0, -200.0, 250.0, 800.0)])
    placed = replace(runs, units=(replace(runs.units[0], arm_m=(-RADIUS_M, 0.0, 0.0), arm_u_m=0.5e-3),))
    chosen = ACCELEROMETER_RANGE.settings.model_validate(ACCELEROMETER).model_dump()
    (unit,) = reduce_accelerometer(placed, chosen)
    assert ("radius_unlike_bench_file" in texts(unit.flags)) == contradicted
    assert "scale factor at this temperature is not as stated" in flag_in_words(Flag("radius_unlike_bench_file"))


def test_an_accelerometer_finds_its_radius_and_bends_at_high_rates():
    unit = accelerometer(*rested(), *map(spun, (180.0, -180.0, 240.0, 800.0, -1100.0)))
    low_g = np.radians([180, 180, 240]) ** 2 * RADIUS_M / 9.8
    radius_m = RADIUS_M * (1 + K2 * np.sum(low_g**3) / np.sum(low_g**2))
    assert values(unit, "rest_output") == pytest.approx([BIAS_G], abs=2e-5)
    assert values(unit, "radius") == pytest.approx([radius_m], abs=5e-5)
    pull_g = np.radians([800, 1100]) ** 2 * RADIUS_M / 9.8
    errors = pull_g + K2 * pull_g**2 - pull_g * radius_m / RADIUS_M
    assert values(unit, "acceleration_error") == pytest.approx(errors, abs=2e-3)
    assert values(unit, "acceleration_error/relative") == pytest.approx(errors / 20, abs=1e-4)
    (radius,) = (found for found in unit.findings if found.quantity == "radius")
    assert {"scale factor as stated", "site: gravity", "counter: time base"} <= {line.source for line in radius.budget}


def test_one_low_rate_is_not_enough_for_a_radius():
    unit = accelerometer(*rested(), spun(180.0), spun(-180.0), spun(800.0))
    assert (texts(unit.flags), unit.left_out) == (("too_few_low_rates",), ("radius",))
    assert [found.quantity for found in unit.findings] == ["rest_output"]


def test_a_radius_that_noise_hides_is_told():
    unit = accelerometer(*rested(), *(at_rate(rate, 20.0) for rate in (5.0, 6.0)), spun(800.0))
    assert texts(unit.flags) == ("radius_not_determined",)


def test_a_converter_in_its_dead_band_tells_no_bias():
    unit = accelerometer(at_rest(0.0), *rested(), *map(spun, (180.0, 240.0, 800.0)))
    assert texts(unit.flags) == ("steps/n=0/acquire: dead_band",)
    assert values(unit, "rest_output") == pytest.approx([BIAS_G], abs=2e-5)


# The curve through the points


def bent(rate_dps, *, scale_error=5e-4, asymmetry=1e-4, cubic=-3e-4):
    part = rate_dps / 400
    read_dps = rate_dps * (1 + scale_error + asymmetry * np.sign(rate_dps) + cubic * part**2)
    return at_rate(rate_dps, 50 + 100 * read_dps)


BOTH_SENSES = [sense * rate for rate in (100, 200, 300, 400) for sense in (1, -1)]


def test_the_curve_of_a_gyro_is_found_and_takes_its_errors_back():
    unit = gyro(*REST, *map(bent, BOTH_SENSES))
    for quantity, value in (("scale_error", 5e-4), ("asymmetry", 1e-4), ("nonlinearity/cubic", -3e-4)):
        (found,) = (each for each in unit.findings if each.quantity == quantity)
        assert abs(found.value - value) < 3 * found.u < 3e-4, quantity
        assert found.budget
        assert len(found.steps) == len(BOTH_SENSES)
    (known,) = unit.compensations
    output = np.array([50 + 100 * rate * (1 + 5e-4 + 1e-4 * np.sign(rate) - 3e-4 * (rate / 400) ** 2)
                       for rate in BOTH_SENSES])  # fmt: skip
    value, beyond = known.apply(output, np.full(len(output), np.nan))
    assert value == pytest.approx(BOTH_SENSES, abs=0.02)
    assert np.abs((output - 50) / 100 - BOTH_SENSES).max() > 0.1
    assert not beyond[np.abs(BOTH_SENSES) < 400].any()
    (model,) = unit.models
    assert model.constants["scale error"].value == known.linearity.coefficients["scale_error"]
    assert model.valid["rate_dps"] == pytest.approx((-400, 400), abs=0.01)


def test_a_point_that_is_saturated_or_unstable_is_not_on_the_curve():
    unit = gyro(*REST, *map(bent, BOTH_SENSES), at_rate(100, 10_050, rate_dps=101), at_rate(500, 42_000))
    assert values(unit, "scale_error") == pytest.approx([5e-4], abs=1e-4)
    (scale_error,) = (each for each in unit.findings if each.quantity == "scale_error")
    assert len(scale_error.steps) == len(BOTH_SENSES)
    assert unit.models[0].valid["rate_dps"][1] == pytest.approx(400, abs=0.01)
    assert gyro(*REST, at_rate(500, 42_000)).compensations == ()


def test_the_curve_of_an_accelerometer_is_its_second_order_part():
    unit = accelerometer(*rested(), *map(spun, (180.0, -180.0, 240.0, 600.0, 800.0, -1000.0, 1100.0)))
    (quadratic,) = (each for each in unit.findings if each.quantity == "nonlinearity/quadratic")
    assert abs(quadratic.value - K2 * 20) < 3 * quadratic.u
    assert quadratic.value == pytest.approx(K2 * 20, rel=0.1)
    scale_error = next(each for each in unit.findings if each.quantity == "scale_error")
    assert "low rates: by way of the radius" in {line.source for line in scale_error.budget}
    (known,) = unit.compensations
    pull_g = np.radians(1050.0) ** 2 * RADIUS_M / 9.8
    (value,), _ = known.apply(np.array([1e4 * (BIAS_G + pull_g + K2 * pull_g**2)]), np.full(1, np.nan))
    low_g = np.radians([180, 180, 240]) ** 2 * RADIUS_M / 9.8
    its_own = 1 + K2 * np.sum(low_g**3) / np.sum(low_g**2)  # by the radius that it found
    assert value == pytest.approx(pull_g * its_own, rel=1e-4)
    assert pull_g * (1 + K2 * pull_g) / its_own > pull_g * 1.001


UNCERTAIN = replace(BENCH, thermometers_u={"warm": (0.3, 0.0)})


def line_of(unit, quantity, source):
    (found,) = (each for each in unit.findings if each.quantity == quantity)
    return next((line.u for line in found.budget if line.source == source), 0.0)


def test_a_scale_error_at_a_temperature_is_as_uncertain_as_its_thermometer():
    """60 ppm/°C by a thermometer that is off by 0.3 °C are 18 ppm; what differs by sense or rate has none of it."""
    steady = [at_rate(sense * rate, 50 + sense * rate * 100) for rate in (100, 200, 400) for sense in (1, -1)]
    settings = GYRO_RANGE.settings.model_validate(GYRO).model_dump()
    (unit,) = reduce_gyro(data(*REST, *steady, bench=UNCERTAIN), settings)
    thermometer = "warm: offset, gain"
    assert line_of(unit, "scale_error", thermometer) == pytest.approx(18e-6)
    assert line_of(unit, "asymmetry", thermometer) == line_of(unit, "nonlinearity/cubic", thermometer) == 0.0


def test_points_at_other_temperatures_than_that_of_the_curve_bend_it_by_what_is_not_known():
    """The later, the faster, the warmer: 100 °/s at 20 °C and 400 °/s at 22 °C look as if the gyro were not linear."""
    steady = [
        replace(at_rate(sense * rate, 50 + sense * rate * 100), temperatures_c={"warm": np.full(2, at_c)})
        for rate, at_c in ((100, 20.0), (200, 21.0), (400, 22.0))
        for sense in (1, -1)
    ]
    unit = gyro(*REST, *steady)
    otherwise_warm = line_of(unit, "nonlinearity/cubic", OTHERWISE_WARM)
    assert 60e-6 < otherwise_warm < 180e-6
    assert line_of(unit, "asymmetry", OTHERWISE_WARM) < 0.01 * otherwise_warm


def noisy_thermometer(*acquisitions, rate_c_per_s=0.0, jumps_c=0.0, seed=4):
    """The same at 20 °C and a line over time, ten readings each that scatter by 0.01 °C."""
    rng = np.random.default_rng(seed)
    return [
        replace(each, temperatures_c={
            "warm": 20 + 60 * n * rate_c_per_s + jumps_c * rng.standard_normal() + 0.01 * rng.standard_normal(10)
        })
        for n, each in enumerate(acquisitions)
    ]  # fmt: skip


STEADY = [at_rate(sense * rate, 50 + sense * rate * 100) for rate in (50, 100, 200, 400) for sense in (1, -1)]


def test_noise_of_a_thermometer_is_no_temperature_of_the_points():
    """Means of ten readings scatter by 3 mK, which would be 0.2 ppm at 60 ppm/°C; no point was warmer by that."""
    units = [gyro(*noisy_thermometer(*REST, *STEADY, *REST, seed=seed)) for seed in range(20)]
    asymmetry, cubic = (
        np.median([line_of(unit, quantity, OTHERWISE_WARM) for unit in units])
        for quantity in ("asymmetry", "nonlinearity/cubic")
    )
    assert asymmetry < 0.02e-6
    assert cubic < 0.08e-6


def test_a_temperature_that_goes_up_evenly_is_seen_through_the_noise_of_the_thermometer():
    warmer = 1e-3  # °C/s; the points are a minute apart
    unit = gyro(*noisy_thermometer(*REST, *STEADY, *REST, rate_c_per_s=warmer))
    noiseless = gyro(*[
        replace(each, temperatures_c={"warm": np.full(2, 20 + 60 * n * warmer)})
        for n, each in enumerate([*REST, *STEADY, *REST])
    ])  # fmt: skip
    expected = line_of(noiseless, "nonlinearity/cubic", OTHERWISE_WARM)
    assert expected > 5e-6
    assert line_of(unit, "nonlinearity/cubic", OTHERWISE_WARM) == pytest.approx(expected, rel=0.05)


def test_errors_name_their_temperature_and_a_gyro_that_warms_up_is_told():
    """0.4 °C are 25 ppm of the scale factor, and an error is known to less."""
    warming = gyro(*noisy_thermometer(*REST, *STEADY, rate_c_per_s=1e-3))
    flag = flag_of(warming.flags, "warming_up")
    assert float(flag.values["ppm"]) == pytest.approx(11 * 60 * 1e-3 * 60, rel=0.1)
    assert "Let the unit warm up for longer" in flag_in_words(flag)
    at_c = [found.at["at_c"] for found in warming.findings if found.quantity == "rate_error"]
    assert np.ptp(at_c) == pytest.approx(7 * 60 * 1e-3, rel=0.1)
    assert gyro(*noisy_thermometer(*REST, *STEADY)).flags == ()
    drifting = replace(BENCH, thermometer_drifts={"warm": Drift(0.3)})
    settings = GYRO_RANGE.settings.model_validate(GYRO).model_dump()
    warming = noisy_thermometer(*REST, *STEADY, rate_c_per_s=1e-3)
    assert reduce_gyro(data(*warming, bench=drifting), settings)[0].flags == ()
    assert gyro(*(replace(each, temperatures_c={"warm": np.full(2, np.nan)}) for each in (*REST, *STEADY))).flags == ()


def test_temperatures_that_scatter_more_than_the_readings_of_each_are_those_of_the_points():
    acquisitions = noisy_thermometer(*REST, *STEADY, *REST, jumps_c=0.1)
    blocks = range_blocks(data(*acquisitions), UNIT, 0.01, 420.0)
    expected_c = [float(np.mean(each.temperatures_c["warm"])) for each in acquisitions if each.motion is not None]
    assert [each.temperature_c for each in blocks.turning] == pytest.approx(expected_c, abs=0.03)
    assert np.ptp([each.temperature_c for each in blocks.turning]) > 0.9 * np.ptp(expected_c)


@pytest.mark.parametrize("changes", [0.0, 1.0, 2.0, 4.0])
def test_the_square_of_a_change_of_temperature_is_not_larger_for_the_noise_of_the_thermometer(changes):
    """A change by so many standard uncertainties of its own: on average what is kept of its square is not too small."""
    rng, share = np.random.default_rng(7), np.linspace(-0.5, 0.5, 24)
    u_c = 0.01 / np.sqrt(10 * np.sum(share**2))
    squares = []
    for _ in range(800):
        means = [
            MeanTemperature.of(20 + changes * u_c * each + 0.01 * rng.standard_normal(10)) for each in share.tolist()
        ]
        found_c = temperatures_c(share.tolist(), means, np.zeros(24))
        squares.append((float(np.polyfit(share, found_c, 1)[0]) / u_c) ** 2)
    assert changes**2 - 0.3 < np.mean(squares) < changes**2 + 0.6  # 1 more without noise taken off


def test_a_thermometer_that_drifts_within_the_run_is_no_change_of_temperature():
    """A thermometer that goes up by 0.06 °C within the run, of a unit that is as warm all along: as stated, or not."""
    points = noisy_thermometer(*REST, *STEADY, *REST, rate_c_per_s=0.06 / (60 * 15))
    settings = GYRO_RANGE.settings.model_validate(GYRO).model_dump()
    lines = []
    for drift_c in (0.0, 0.1):
        bench = replace(BENCH, thermometer_drifts={"warm": Drift(drift_c)})
        (unit,) = reduce_gyro(data(*points, bench=bench), settings)
        lines.append(line_of(unit, "nonlinearity/cubic", OTHERWISE_WARM))
    assert lines[0] > 0.5e-6
    assert lines[1] < 0.1 * lines[0]


def test_a_radius_is_as_uncertain_as_a_scale_factor_that_is_stated_at_another_temperature():
    low = (*rested(), *map(spun, (180.0, -180.0, 240.0)))
    for stated_c, away_c in ((20.0, 0.5), (13.5, 7.0)):
        radius = accelerometer(*low, scale_at=f"{stated_c} °C")
        assert line_of(radius, "radius", STATED_AT) == pytest.approx(6e-5 * away_c * RADIUS_M, rel=1e-3)
