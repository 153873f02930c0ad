"""Test methods as a sequence sees them: known by entry point, without their arithmetic."""

from __future__ import annotations

import json
import sys
from importlib import import_module, metadata

import pytest
from pydantic import ValidationError

from bench.errors import InputError
from bench.figures import numbers, words
from bench.figures.languages import catalogue_of, language, tr
from bench.figures.numbers import scale_shown
from bench.methods.tumble.method import TEMPERATURE_TUMBLE
from bench.metrology.results.flag import Flag
from bench.offline.case import reduce_case, reduced_case, reductions
from bench.report import flag_words
from bench.report.flag_words import flag_in_words
from bench.sequence.checks.rules import every_rule, judge
from bench.sequence.method import OUTPUT_UNITS, SHIPPED, MethodWords, known_methods, texts_of
from drivers.description import known_drivers
from drivers.quantity.units import parse_unit
from drivers.shipped import DRIVERS
from tests.support.runs import ROOT, SHORT, run_short
from tests.support.sequences import BENCH, plan_of, problems_of, steps


@pytest.mark.parametrize("method", known_methods().values(), ids=lambda method: method.name)
def test_a_method_is_found_under_its_own_name_and_can_be_imported(method):
    assert known_methods()[method.name] is method
    module, _, function = method.target.partition(":")
    assert callable(getattr(import_module(module), function))
    assert all(parse_unit(unit) for output in OUTPUT_UNITS for unit in method.units(output).values())


@pytest.mark.lengthy
def test_limits_may_name_what_a_run_finds_in_the_unit_it_is_found_in(tmp_path):
    warmer = ["temperatures=[20 °C, 30 °C, 40 °C, 30 °C, 20 °C]", *SHORT[1:]]  # a parabola needs three temperatures
    result = run_short(tmp_path, settings=tuple(warmer))
    assert result.results is not None
    (unit,) = result.results.units
    found = {finding.quantity: finding.unit for finding in unit.findings}
    expected, elsewhere = TEMPERATURE_TUMBLE.units("pulse/s"), ("K3", "Kip", "Kio", "asymmetry", "misalignment_y")
    assert found == {name: unit for name, unit in expected.items() if name not in elsewhere}, (
        "at four angles, in one mount"
    )


@pytest.mark.parametrize(("raw", "degree"), [({}, 4), ({"degree": 1}, 1), ({"degree": 4}, 4)])
def test_the_degree_of_the_temperature_model_is_1_to_4(raw, degree):
    assert TEMPERATURE_TUMBLE.settings.model_validate(raw).model_dump()["degree"] == degree


@pytest.mark.parametrize("degree", [0, 5, 2.0, "2", True, None])
def test_any_other_degree_is_refused(degree):
    with pytest.raises(ValidationError):
        TEMPERATURE_TUMBLE.settings.model_validate({"degree": degree})


PLUGIN = """\
from bench.sequence.method import MethodDescription
from drivers.schema.fields import StrictModel


class Settings(StrictModel):
    depth: int = 1


NOISE = MethodDescription(
    "noise", "Noise", "my_noise:reduce", Settings, {"density": "µg/Hz^0.5", "K0/change": "V"},
    shown={"density": "ng/Hz^0.5", "K0/change": "mV"}, rules="my_noise_parts:RULES", words="my_noise_parts:WORDS",
    translations="my_noise_parts:TRANSLATIONS", offline="my_noise_parts:REDUCTIONS",
)
"""
PARTS = """\
from bench.metrology.results.flag import Flag
from bench.offline.case_file import Reduction, Settings
from bench.sequence.checks.remarks import Rule

SHALLOW = "shallow: {depth} m"


class CaseSettings(Settings):
    depth: int


def too_deep(plan, bench):
    for index, entry in enumerate(plan.sequence.results):
        if entry.settings.get("depth", 1) > 8:
            yield ("results", index, "settings", "depth"), "a depth above 8 finds nothing", "Choose 8 or less"


def reduced(case):
    rest = case.record("rest", "U_V")
    depth = case.settings(CaseSettings).depth
    flags = [Flag(SHALLOW, values={"depth": depth})] if depth < 2 else ["any_missing", "this is: invalid"]
    mean, parts = rest.numbers("U_V").mean(), [None] if depth > 8 else [1]
    return {"depth": depth, "mean": mean, "parts": parts, "flags": flags, "notes": [], "doubts": []}


RULES = (Rule("too-deep", "warning", "a depth finds something", too_deep),)
WORDS = {
    "UNITS": {"deaf": "It hears nothing.", "{n} Hz deaf": "It hears nothing at {n} Hz.", "no_sweep": "Not mine."},
    "REASONS": {"loud": "it is loud"},
    "CONDITIONS": {"band_hz": "over {value} Hz"},
    "NOTES": ("the fan ran at {speed} turns",),
    "SOURCES": ("fan",),
}
CHINESE = {"It hears nothing at {n} Hz.": "在 {n} Hz 听不到。", "fan": "风扇", "hum": "嗡声", "Dwell": "Mine"}
TRANSLATIONS = {"zh": CHINESE}
REDUCTIONS = {("NOISE", ""): Reduction(reduced, ("rest",), parts=("parts",), lacking=frozenset({SHALLOW}))}
"""


def test_a_plug_in_cannot_take_the_name_of_a_shipped_method(plugin, monkeypatch):
    (found,) = [each for each in known_methods() if each == "threshold"]
    points = metadata.EntryPoints([metadata.EntryPoint("threshold", "my_noise:NOISE", "inertial_test_bench.methods")])
    monkeypatch.setattr("drivers.installed._points", lambda _: points)
    known_methods.cache_clear()
    assert known_methods()[found].name == "threshold"
    assert "noise" not in known_methods()
    assert len(known_methods()) == len(list(known_methods())) == len(SHIPPED)


def test_every_driver_package_is_in_the_table_of_shipped_ones():
    packages = {path.parent.name for path in (ROOT / "drivers/dialects").glob("*/description.py")}
    assert packages == {target.split(".")[2] for target in DRIVERS.values()}


def test_what_is_in_the_tables_is_there_under_its_name():
    assert [known_drivers()[name].name for name in DRIVERS] == list(DRIVERS)
    assert [known_methods()[name].name for name in SHIPPED] == list(SHIPPED)


def forget():
    """What was looked up among other methods is looked up again."""
    for cached in (known_methods, reductions, texts_of, scale_shown, numbers._units_shown, catalogue_of):
        cached.cache_clear()
    for looked_up in (flag_words._UNITS, words.REASONS, words.CONDITIONS):
        vars(looked_up).pop("_all", None)


@pytest.fixture
def plugin(tmp_path, monkeypatch):
    """An installed distribution with a method of its own."""
    (tmp_path / "my_noise.py").write_text(PLUGIN)
    (tmp_path / "my_noise_parts.py").write_text(PARTS)
    information = tmp_path / "my_noise-1.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: my-noise\nVersion: 1\n")
    (information / "entry_points.txt").write_text("[inertial_test_bench.methods]\nnoise = my_noise:NOISE\n")
    monkeypatch.syspath_prepend(tmp_path)
    forget()
    yield
    forget()
    for module in ("my_noise", "my_noise_parts"):
        sys.modules.pop(module, None)


def test_a_method_of_a_plug_in_is_known_to_a_sequence(plugin, tmp_path):
    body = steps("{acquire: counter, for: 1 h, label: rest}") + "results:\n  - {method: noise, data: rest, "
    assert len(plan_of(tmp_path, body + "settings: {depth: 3}, limits: {density: {max: 5 µg/Hz^0.5}}}\n")) == 1
    assert problems_of(tmp_path, body + "settings: {dept: 3}, limits: {density: {max: 5 µg}}}\n") == [
        "4:44: dept: unknown key; did you mean 'depth'?",
        "4:73: max: is in g, expected a quantity in µg/Hz^0.5",
    ]


def test_a_plug_in_brings_rules_that_only_its_method_loads(plugin, tmp_path):
    body = steps("{acquire: counter, for: 1 h, label: rest}") + "results:\n  - {method: noise, data: rest, "
    assert "my_noise_parts" not in sys.modules
    judge(plan_of(tmp_path, steps("{acquire: counter, for: 1 h, label: rest}")), BENCH)
    assert "my_noise_parts" not in sys.modules
    found = judge(plan_of(tmp_path, body + "settings: {depth: 9}}\n"), BENCH)
    assert "a depth above 8 finds nothing. Choose 8 or less [too-deep]" in [remark.text for remark in found]
    assert "too-deep" in {rule.name for rule in every_rule()}


def test_a_plug_in_brings_the_words_of_its_flags(plugin):
    own = MethodWords("UNITS", {"generic": "A word."})
    assert (own["generic"], own["deaf"]) == ("A word.", "It hears nothing.")
    assert "rest_missing" in own
    assert "nothing_known" not in own


def test_its_words_are_in_a_report_in_both_languages(plugin):
    assert flag_in_words(Flag("{n} Hz deaf", values={"n": 30})) == "It hears nothing at 30 Hz."
    assert flag_in_words(Flag("the fan ran at 3 turns", at="a")) == "a: the fan ran at 3 turns"
    assert words.where({"band_hz": 20.0}, {}) == "over 20 Hz"
    assert words.REASONS["loud"] == "it is loud"
    with language("zh"):
        assert flag_in_words(Flag("{n} Hz deaf", values={"n": 30})) == "在 30 Hz 听不到。"
        assert words.source_in_words("fan: hum") == "风扇：嗡声"


def test_words_of_the_program_are_not_replaced_by_those_of_a_plug_in(plugin):
    assert flag_in_words(Flag("no_sweep")) == "There is no reading of a sweep, so that nothing can be determined."
    with language("zh"):
        assert tr("Dwell") == "温度点"


def test_a_plug_in_says_in_which_unit_its_quantities_are_shown(plugin):
    assert scale_shown("density", "µg/Hz^0.5") == (1000.0, "ng/Hz^0.5")
    assert scale_shown("K0/change", "V") == (1000.0, "mV")
    assert scale_shown("K0/change", "g") == (1e6, "µg")
    assert scale_shown("of nobody", "V") == (1.0, "V")


@pytest.mark.parametrize("method", known_methods().values(), ids=lambda method: method.name)
def test_shown_units_are_of_the_kind_of_their_quantities(method):
    for quantity, symbol in method.displayed.items():
        own = parse_unit(method.stated.get(quantity, "g"))  # of a result that has no limits
        assert parse_unit(symbol or "1").dimension == own.dimension, quantity


def test_a_plug_in_reduces_cases_of_its_own(plugin, tmp_path):
    (tmp_path / "rest.csv").write_text("U_V\n1.0\n2.0\n")
    case = {"schema": "itb-case/1", "method": "NOISE", "settings": {"depth": 3}, "records": {"rest": "rest.csv"}}
    (tmp_path / "case.json").write_text(json.dumps(case))
    found = reduce_case(tmp_path / "case.json")
    assert (found["method"], found["depth"], found["mean"]) == ("NOISE", 3, 1.5)
    (tmp_path / "case.json").write_text(json.dumps({**case, "settings": {"dept": 3}}))
    with pytest.raises(InputError, match="did you mean 'depth'"):
        reduce_case(tmp_path / "case.json")


@pytest.mark.parametrize(
    ("depth", "expected"),
    [(3, ("REDUCED", [])), (1, ("INCOMPLETE", ["shallow: 1 m"])), (9, ("INCOMPLETE", ["nothing"]))],
)
def test_it_says_itself_which_of_its_cases_lack_something(plugin, tmp_path, depth, expected):
    (tmp_path / "rest.csv").write_text("U_V\n1.0\n2.0\n")
    case = {"schema": "itb-case/1", "method": "NOISE", "settings": {"depth": depth}, "records": {"rest": "rest.csv"}}
    (tmp_path / "case.json").write_text(json.dumps(case))
    found = reduced_case(tmp_path / "case.json")
    assert (found.outcome, list(found.lacking)) == expected
