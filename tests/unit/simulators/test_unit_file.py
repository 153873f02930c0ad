import hashlib
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.stats import truncnorm

from bench.config.load import load_file
from bench.errors import InputError
from simulators.units.accelerometer import UnitTruth, draw_unit
from simulators.units.unit_file import Draw, UnitFile, stream
from tests.support.laboratory import ROOT, unit

EXAMPLE = ROOT / "config" / "uut" / "quartz_flexure.yaml"


def edited(folder: Path, old: str, new: str) -> UnitFile:
    text = EXAMPLE.read_text("utf-8")
    assert old in text, old
    path = folder / "unit.yaml"
    path.write_text(text.replace(old, new), "utf-8")
    return load_file(path, UnitFile)


# The shipped file


def test_every_value_of_the_example_arrives_in_its_unit() -> None:
    truth = draw_unit(load_file(EXAMPLE, UnitFile), seed=1, place="a")
    expected = UnitTruth(
        reference_c=20,
        bias=(0.8e-3, 10e-6, 0.03e-6, 4e-10, 0),
        scale_a_per_g=1.13e-3,
        scale=(1, -58e-6, 0.02e-6, 0, 0),
        k2=20e-6,
        k3=0.05e-6,
        kip=5e-6,
        kio=5e-6,
        misalignment_o=0.3e-3,
        misalignment_p=-0.5e-3,
        kd=-600e-6,  # 10 µg at 1 °C/min is 600 µg at 1 °C/s
        hysteresis_g=60e-6,
        thresholds_c=(5, 10, 20, 30, 40),
        drift_g_per_s=truth.drift_g_per_s,  # drawn
        warm_up_g=50e-6,
        warm_up_s=1200,
        noise_density=2e-6,
        instability_g=0.5e-6,
        range_g=20,
        pulses_per_a=1e7,
        alpha=10e-6,
        asymmetry=30e-6,
        nonlinearity=30e-6,
        full_scale_a=25.6e-3,
        zero_pps=2,
        zero_drift_pps=0.004,
        dead_band_a=20e-9,
        max_rate_pps=256_000,
        counter_bits=24,
        converter_c=25,
        supply_a=0.06,
    )
    for name in UnitTruth.__dataclass_fields__:
        value = getattr(expected, name)
        assert getattr(truth, name) == (value if value is None else pytest.approx(value, rel=1e-12)), name


def test_the_drift_of_the_example_is_drawn_around_none() -> None:
    loaded = load_file(EXAMPLE, UnitFile)
    assert loaded.accelerometer.drift == Draw(0.0, pytest.approx(1.6e-6 / 86_400))
    drawn = [draw_unit(loaded, seed, "a").drift_g_per_s * 86_400 / 1.6e-6 for seed in range(400)]
    assert np.mean(drawn) == pytest.approx(0, abs=0.15)
    assert np.std(drawn) == pytest.approx(0.95, abs=0.1)


def test_the_thermal_values_of_the_example() -> None:
    thermal = load_file(EXAMPLE, UnitFile).thermal
    assert (thermal.case_time_constant, thermal.sensor_time_constant, thermal.self_heating) == (180, 60, 5)


# Draws


def test_a_distribution_is_cut_at_two_and_a_half_sd() -> None:
    values = np.array([Draw(3.0, 2.0).value(stream(seed, "cut")) for seed in range(20_000)])
    assert np.abs(values - 3).max() <= 5.0
    assert np.abs(values - 3).max() > 4.8, "it is cut, not narrowed"
    assert values.mean() == pytest.approx(3, abs=0.06)
    assert values.std() == pytest.approx(2 * truncnorm.std(-2.5, 2.5), rel=0.02)


def test_a_fixed_value_is_what_it_says() -> None:
    assert Draw(3.0).value(stream(1, "fixed")) == 3.0


def test_streams_belong_to_their_seed_and_path_for_ever() -> None:
    digest = hashlib.sha256(b"7/uut/a/accelerometer/K2").digest()
    alone = np.random.Generator(np.random.PCG64(int.from_bytes(digest[:16], "big")))
    assert stream(7, "uut", "a", "accelerometer", "K2").standard_normal(5).tolist() == alone.standard_normal(5).tolist()
    first = [stream(seed, *path).standard_normal() for seed in (1, 2) for path in (("a",), ("b",), ("a", "b"))]
    assert len(set(first)) == 6


def drawn_everywhere(**fixed: str) -> UnitFile:
    """A unit all of whose terms are drawn, but for those that are fixed."""
    terms = {
        "K2": {"mean": "20 µg/g²", "sd": "5 µg/g²"}, "K3": {"mean": "0 µg/g³", "sd": "1 µg/g³"},
        "Kip": {"mean": "5 µg/g²", "sd": "1 µg/g²"}, "misalignment_o": {"mean": "0 mrad", "sd": "1 mrad"},
    }  # fmt: skip
    bias = {"at_reference": {"mean": "0 mg", "sd": "1 mg"}, "linear": {"mean": "10 µg/°C", "sd": "1 µg/°C"}}
    return unit(
        accelerometer={**terms, "K0": bias, **fixed}, converter={"zero": {"mean": "2 pulse/s", "sd": "1 pulse/s"}}
    )


def test_fixing_one_value_changes_no_other() -> None:
    free, fixed = (draw_unit(file, 5, "a") for file in (drawn_everywhere(), drawn_everywhere(K3="0.05 µg/g³")))
    assert free.k3 != fixed.k3 == pytest.approx(5e-8)
    for name in set(UnitTruth.__dataclass_fields__) - {"k3"}:
        assert getattr(free, name) == getattr(fixed, name), name
    assert len({free.k2 / 5e-6 - 4, free.k3 / 1e-6, free.kip / 1e-6 - 5, free.misalignment_o / 1e-3}) == 4


def test_two_places_hold_two_units() -> None:
    here, there = (draw_unit(drawn_everywhere(), 5, place) for place in "ab")
    assert here.k2 != there.k2
    assert here == draw_unit(drawn_everywhere(), 5, "a")


# What a file may say


def test_a_unit_that_its_converter_cannot_follow_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"range x K1 x S is 226000 pulse/s, above the converter's max_rate 200000"):
        edited(tmp_path, "max_rate: 256 kHz", "max_rate: 200 kHz")
    with pytest.raises(InputError, match="range x K1 x S is 339000 pulse/s"):
        edited(tmp_path, "range: 20 g", "range: 30 g")
    with pytest.raises(InputError, match="range x K1 x S is 271200 pulse/s"):
        edited(tmp_path, "S: 10 kHz/mA", "S: -12 kHz/mA")
    edited(tmp_path, "max_rate: 256 kHz", "max_rate: 226 kHz")


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("K2: 20 µg/g²", "K2: 20 µg/g", "unit.yaml:.*K2.*1/g"),
        ("K2: 20 µg/g²", "K2: 20", "unit.yaml:.*K2"),
        ("K2: 20 µg/g²", "K4: 20 µg/g²", "unit.yaml:.*K4"),
        ("sd: 1.6 µg/day", "sd: -1.6 µg/day", "unit.yaml:.*sd"),
        ("sd: 1.6 µg/day", "sd: 1.6 µg", "unit.yaml:.*sd"),
        ("{mean: 0 µg/day, sd: 1.6 µg/day}", "{mean: 0 µg/day}", "unit.yaml:.*sd"),
        ("{mean: 0 µg/day, sd: 1.6 µg/day}", "{mean: 0 µg/day, sd: 1 µg/day, max: 1 µg/day}", "unit.yaml:.*max"),
        ("thresholds: [5 °C", "thresholds: [0 °C", "unit.yaml:.*is 0 °C, expected more than 0 °C"),
        ("counter_bits: 24", "counter_bits: 65", "unit.yaml:.*counter_bits"),
        ("schema: itb-uut/1", "schema: itb-uut/2", "unit.yaml:.*schema"),
    ],
)
def test_a_wrong_file_is_told_where_it_is_wrong(tmp_path: Path, old: str, new: str, problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        edited(tmp_path, old, new)


def test_what_is_left_out_is_perfect() -> None:
    truth = draw_unit(unit(), 1, "a")
    assert truth.bias == (0, 0, 0, 0, 0)
    assert truth.scale == (1, 0, 0, 0, 0)
    perfect = ("k2", "k3", "kip", "kio", "misalignment_o", "kd", "hysteresis_g", "noise_density", "alpha", "asymmetry")
    assert [getattr(truth, name) for name in perfect] == [0] * len(perfect)


def test_a_draw_needs_a_number_or_a_distribution() -> None:
    with pytest.raises(ValidationError, match="K2"):
        unit(accelerometer={"K2": ["20 µg/g²"]})
