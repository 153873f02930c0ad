"""The line for repeatability over power cycles: its size, and which results have it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from bench.config.places import PlaceEntry, PowerCyclesEntry
from bench.methods.tumble.method import TemperatureTumbleSettings
from bench.methods.tumble.reduction.run import reduce
from bench.metrology.acquisition import Acquisition, Codes, Shift, Voltages
from bench.metrology.bench_uncertainty import AxisRecord, BenchRecord
from bench.metrology.outputs import mean_of
from bench.metrology.power_cycles import SOURCE, reduced
from bench.metrology.pulse_counts import mean_rate, shifted_counts
from bench.metrology.results.finding import Finding, Interval, UnitResult
from bench.metrology.run_data import PowerCycles, RunData, UnitUnderTest
from tests.unit.metrology.test_counts import counted

BENCH = BenchRecord(
    gravity_mps2=9.8, gravity_u_mps2=0.0, axes={"head": AxisRecord()}, x=(1.0, 0.0, 0.0), z=(0.0, 0.0, 1.0),
    level_deg=0.0, level_u_deg=0.0, time_base_u=0.0, thermometers_u={"t": (0.0, 0.0)},
)  # fmt: skip
BIAS_G, SCALE = 20e-6, 30e-6
UNIT = UnitUnderTest("a", "S1", "x", 0.0, "t", voltmeter="dvm", power_cycles=PowerCycles(BIAS_G, SCALE))
POSITIONS_DEG = (0.0, 90.0, 180.0, 270.0, 270.0, 180.0, 90.0, 0.0)
SET_C = (20.0, 40.0, 20.0)
SETTINGS = TemperatureTumbleSettings.model_validate({"degree": 1}).model_dump()


def run(stretches: Sequence[int], unit: UnitUnderTest = UNIT) -> RunData:
    """Tumbles at three temperatures; each reading belongs to a stretch between interruptions."""
    rng, found = np.random.default_rng(3), []
    for number, stretch in enumerate(stretches):
        dwell, position = divmod(number, len(POSITIONS_DEG))
        at_s = number * 60.0 + np.arange(0.5, 60.0)
        volts = 2.0 * (np.sin(np.radians(POSITIONS_DEG[position])) + 1e-3) + rng.normal(0, 1e-7, len(at_s))
        group = f"steps/temperature={dwell}"
        found.append(Acquisition(
            step=f"{group}/position={position}/acquire", group=group, begin_s=number * 60.0,
            end_s=(number + 1) * 60.0, set_from_c=SET_C[dwell], set_c=SET_C[dwell], counts={},
            loops={"temperature": float(dwell)}, angles_deg={"head": POSITIONS_DEG[position]},
            voltages={"dvm": Voltages(at_s, volts)}, temperatures_c={"t": np.full(60, SET_C[dwell])},
            temperatures_at_s={"t": at_s}, stretch=stretch,
        ))  # fmt: skip
    return RunData("tumble", (unit,), tuple(found), BENCH)


def findings(stretches: Sequence[int], unit: UnitUnderTest = UNIT) -> dict[str, Finding]:
    (result,) = reduced(reduce, run(stretches, unit), SETTINGS)
    return {finding.id.removeprefix("tumble/a/"): finding for finding in result.findings}


def line(finding: Finding) -> float:
    """The size of the line; 0 without one."""
    return math.fsum(each.u for each in finding.budget if each.source == SOURCE)


IN_A_DWELL = [0] * 4 + [1] * 20
BETWEEN_DWELLS = [0] * 8 + [1] * 16


def test_a_dwell_on_both_sides_has_what_each_half_of_it_contributes():
    found = findings(IN_A_DWELL)
    assert line(found["K0@temperature=0"]) == pytest.approx(BIAS_G / math.sqrt(2), rel=1e-3)
    assert line(found["K1@temperature=0"]) == pytest.approx(2.0 * SCALE / math.sqrt(2), rel=1e-3)


def test_a_dwell_on_one_side_has_none():
    found = findings(IN_A_DWELL)
    assert [line(found[f"{name}@temperature={n}"]) for name in ("K0", "K1", "K2") for n in (1, 2)] == [0.0] * 6


def test_coefficients_and_the_closure_have_it_from_dwells_on_both_sides():
    found = findings(BETWEEN_DWELLS)
    assert line(found["K0@temperature=0"]) == 0.0
    assert line(found["K0/closure"]) == pytest.approx(math.sqrt(2) * BIAS_G, rel=1e-3)
    # The dwell before it is at 20 °C, as the last, and the one at 40 °C after it.
    assert line(found["K0T1"]) == pytest.approx(math.sqrt(2) * BIAS_G / 2 / 20, rel=1e-3)
    assert line(found["K1T1"]) == pytest.approx(math.sqrt(2) * SCALE / 2 / 20, rel=1e-3)


def test_three_stretches_count_each_for_itself():
    found = findings([0] * 8 + [1] * 8 + [2] * 8)
    weights = np.array([-0.5, 1.0, -0.5]) / 20  # of the dwells in K0T1
    assert line(found["K0T1"]) == pytest.approx(BIAS_G * float(np.linalg.norm(weights)), rel=1e-3)


def test_it_is_in_the_combined_uncertainty():
    found = findings(BETWEEN_DWELLS)["K0/closure"]
    assert found.u == pytest.approx(math.hypot(*(each.u for each in found.budget)))
    assert found.u > BIAS_G


def test_without_an_interruption_nothing_is_reduced_twice():
    calls = []

    def counting(data, settings):
        calls.append(data)
        return reduce(data, settings)

    reduced(counting, run([0] * 24), SETTINGS)
    assert len(calls) == 1


def test_the_values_are_what_they_are_without_it():
    plain, lined = findings(BETWEEN_DWELLS, replace(UNIT, power_cycles=None)), findings(BETWEEN_DWELLS)
    assert {name: each.value for name, each in plain.items()} == {name: each.value for name, each in lined.items()}
    assert not any(line(each) for each in plain.values())


def test_zero_states_that_there_is_nothing():
    assert not any(map(line, findings(IN_A_DWELL, replace(UNIT, power_cycles=PowerCycles(0.0, 0.0))).values()))


def test_an_interruption_within_a_dwell_is_no_scatter_of_readings():
    data = run(IN_A_DWELL)
    stepped = tuple(
        replace(each, voltages={"dvm": Voltages(found.at_s, found.values_v + 4e-5 * each.stretch)})
        for each in data.acquisitions
        for found in each.voltages.values()
    )
    (result,) = reduced(reduce, replace(data, acquisitions=stepped), SETTINGS)
    (k0,) = (each for each in result.findings if each.id == "tumble/a/K0@temperature=1")
    assert k0.u == pytest.approx(findings(BETWEEN_DWELLS)["K0@temperature=1"].u, rel=0.5)


def test_an_interval_is_widened():
    def spread(data, _settings):
        values = [float(np.mean(each.voltages["dvm"].values_v)) for each in data.acquisitions]
        found = bare.findings[0]
        return [replace(bare, findings=(replace(found, value=values[-1] - values[0]),))]

    finding = data_finding("K1/spread", Interval(1e-6, 2e-6, 0.0))
    bare = UnitResult("a", "S1", (finding,), (), (), ())
    (result,) = reduced(spread, run(BETWEEN_DWELLS, replace(UNIT, nominal_per_g=2.0)), {})
    (found,) = result.findings
    assert found.interval is not None
    assert found.interval.high > 2e-6 + 2.0 * BIAS_G


def data_finding(quantity: str, interval: Interval) -> Finding:
    return Finding(f"tumble/a/{quantity}", "S1", quantity, "", {}, 0.0, "V", (), (), interval=interval)


def test_a_bias_without_a_scale_factor_leaves_the_uncertainty_unknown():
    def bare(data, _settings):
        return [UnitResult("a", "S1", (data_finding("x", Interval(0, 1, 0)),), (), (), ())]

    (result,) = reduced(bare, run(BETWEEN_DWELLS), {})
    assert result.verdict == "INCOMPLETE"
    assert result.findings[0].verdict == "INVALID"


# What each kind of output makes of a shift


def test_counts_are_shifted_to_a_fraction_of_a_pulse():
    counts = counted(1000.0)
    shifted = replace(counts, shift=Shift(1 + 1e-5, 0.003))
    assert mean_rate(shifted).net_pps - mean_rate(counts).net_pps == pytest.approx(0.013, rel=1e-6)


def test_whole_counts_are_shifted_without_a_counter_that_runs_backwards():
    counts, seconds = counted(-1000.0), np.arange(101) * 0.1
    for shift, pps in ((Shift(more=5.0), -995.0), (Shift(more=1500.0), 500.0), (Shift(1.01), -1010.0)):
        positive, negative = (np.diff(each) % 2**24 for each in shifted_counts(replace(counts, shift=shift), seconds))
        assert (positive.sum() - negative.sum()) / 10.0 == pytest.approx(pps, abs=0.1)
        assert max(positive.max(), negative.max()) < 200
    assert shifted_counts(counts, seconds) == (counts.positive, counts.negative)


def test_codes_and_volts_are_shifted():
    shift = Shift(1.5, 0.25)
    number = np.arange(20)
    codes = Codes(
        number, number * 1000, np.linspace(1, 2, 20), number * 1e-3, 32, 1e-6, 1e-3, lost=0, dropped=0, invalid=0
    )
    assert mean_of(replace(codes, values=shift.of_each(codes.values))).value == pytest.approx(
        shift.of(mean_of(codes).value)
    )


# What a bench file states


@pytest.mark.parametrize(
    "stated", [{}, {"bias": "20 µg"}, {"gyro_scale": "10 ppm"}, {"bias": "-1 µg", "scale": "1 ppm"}, {"k": 2}]
)
def test_half_a_statement_is_refused(stated):
    with pytest.raises(ValidationError):
        PowerCyclesEntry.model_validate(stated)


def test_it_is_stated_with_its_coverage():
    entry = PowerCyclesEntry.model_validate({"bias": "20 µg", "scale": "10 ppm", "k": 2})
    assert PowerCycles(**entry.standard_u) == PowerCycles(pytest.approx(10e-6), pytest.approx(5e-6))


def test_an_inertial_unit_needs_both_kinds():
    channels = {f"{kind}_{axis}": f"{kind}{axis}" for kind in ("acc", "gyro") for axis in "xyz"}
    place = {"channels": channels, "temperature": "t", "supply": "supply"}
    half = {"bias": "20 µg", "scale": "10 ppm"}
    both = {**half, "gyro_bias": "1e-5 °/s", "gyro_scale": "10 ppm"}
    stated = [PlaceEntry.model_validate({**place, "power_cycles": each}).has_power_cycles for each in (half, both)]
    assert stated == [False, True]
    assert not PlaceEntry.model_validate(place).has_power_cycles
