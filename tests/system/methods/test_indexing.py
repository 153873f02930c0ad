"""A calibration on an indexing table, run whole: in volts and in pulses, with what can go wrong on the way."""

import dataclasses
from unittest import mock

import pytest

from bench.errors import InputError
from bench.figures.languages import language
from bench.figures.numbers import shown
from bench.figures.sheet import Sheet
from bench.figures.svg import drawing
from bench.methods.indexing import shown as indexing_shown
from bench.methods.indexing.method import INDEXING_STATIC
from bench.methods.indexing.reduction import readings as indexing_readings
from bench.methods.indexing.reduction import run as indexing_static
from bench.methods.indexing.reduction.budget import SCATTER
from bench.methods.indexing.reduction.sweep import EndFit
from bench.reduce.stored_run import open_run
from bench.report.flag_words import flag_in_words
from bench.report.tables import model_sheet
from bench.store.reader import RunReader
from campaigns.truth.campaign import full_bench
from campaigns.truth.indexing import INPUT_HYSTERESIS, QUANTITIES, compare_indexing
from campaigns.truth.signs import differences
from simulators.world import World
from tests.support.flags import flag_of, texts
from tests.support.runs import ROOT, read_json, run_short

pytestmark = pytest.mark.slow

SHORT = ("step=0.25°", "warm_up=20 min")
SHORTEST = ("step=0.5°", "warm_up=20 min")
SETTINGS = {"scale_tolerance": 1e-4, "k": 2.0, "output_limit_g": 9.6e-3, "outlier_k": 6.0,
            "bias_per_c_u": 1e-6, "scale_per_c_u": 6e-5,
            "platform_rad": None, "platform_u_rad": 0.0}  # fmt: skip


def calibrated(folder, bench, settings=SHORT, edits=(), sequence="indexing_static", **options):
    path = full_bench(folder / "config", bench)
    for file, old, new in edits:
        text = (folder / "config" / file).read_text("utf-8")
        assert old in text, old
        (folder / "config" / file).write_text(text.replace(old, new), "utf-8")
    return run_short(folder / "runs", bench=path, sequence=sequence, settings=settings, **options)


@pytest.fixture(scope="module")
def volts(tmp_path_factory):
    return calibrated(tmp_path_factory.mktemp("volts"), "indexing", no_report=False)


@pytest.fixture(scope="module")
def pulses(tmp_path_factory):
    return calibrated(tmp_path_factory.mktemp("pulses"), "indexing_pulses", SHORTEST, seed=2)


@pytest.fixture(scope="module")
def data(volts):
    with open_run(volts.path) as run:
        return run.data("indexing")


def reduced(data, acquisitions=None, **settings):
    data = data if acquisitions is None else dataclasses.replace(data, acquisitions=tuple(acquisitions))
    (unit,) = indexing_static.reduce(data, SETTINGS | settings)
    return unit, {finding.quantity: finding for finding in unit.findings}


def by_end(data, end):
    """The acquisitions that are not of a sweep on an end."""
    return [each for each in data.acquisitions if f"end={end}/" not in each.step]


def test_errors_stay_within_their_uncertainties(volts, pulses):
    for run in (volts, pulses):
        assert run.problems == []
        comparisons = compare_indexing(run.path)
        assert {comparison.quantity for comparison in comparisons} == set(QUANTITIES) - {
            "Kio",
            "misalignment_y",
        }  # which need both sides
        assert max(abs(comparison.ratio) for comparison in comparisons) < 3.5


def test_repeats_that_are_equal_by_chance_make_no_result_more_certain_than_its_readings_are(data):
    _, found = reduced(data)
    with mock.patch.object(EndFit, "repeats", return_value=(0.0, 7)):
        _, by_chance = reduced(data)
    for quantity in ("K1", "misalignment", "Kip"):
        (of_scatter, usual) = (
            next(line.u for line in each[quantity].budget if line.source == SCATTER) for each in (by_chance, found)
        )
        assert 0.01 < of_scatter / usual <= 1, quantity


def test_everything_is_found_in_the_unit_of_the_output(volts, pulses):
    for run, unit in ((volts, "V"), (pulses, "pulse/s")):
        results = read_json(run, "results.json")
        found = {finding["quantity"]: finding["unit"] for finding in results["findings"]}
        assert results["verdict"] == "PASS"
        assert found.items() <= INDEXING_STATIC.units(unit).items()
        assert set(INDEXING_STATIC.quantities) - set(found) == {"K2", "K3", "b4", "Kio", "misalignment_y"}
        assert [model["quantity"] for model in results["models"]] == [
            "acceleration", "acceleration_up", "acceleration_down", "output",
        ]  # fmt: skip


def test_the_tilt_of_the_seat_is_taken_out_of_the_bias(volts):
    found = {finding["quantity"]: finding for finding in read_json(volts, "results.json")["findings"]}
    parts = {name: {line["source"]: line["u"] for line in found[name]["budget"]} for name in ("bias", "bias_corrected")}
    for source in ("head: zero", "fixture: level"):
        assert parts["bias_corrected"].get(source, 0.0) < 1e-3 * parts["bias"][source]
    assert found["bias_corrected"]["u"] < 0.1 * found["bias"]["u"]
    assert found["bias"]["value"] - found["b3"]["value"] - found["b5"]["value"] == pytest.approx(
        found["bias_corrected"]["value"], rel=1e-9
    )


def test_the_report_draws_both_ends_and_tells_the_attempts(volts):
    page = (volts.path / "report.html").read_text("utf-8")
    for words in ("Sweeps of both ends", "Residuals of both ends", "+Z up, forward", "+Z down, reverse", "verification",
                  "Scale factors of both ends", "agree", "Angles below ±30° do not separate K2 and K3"):  # fmt: skip
        assert words in page


def test_every_reading_is_the_mean_of_a_stable_minute(data):
    assert {each.over_s for each in data.acquisitions} == {60.0}
    assert {each.stable for each in data.acquisitions} == {frozenset({"a"})}
    assert all(each.end_s - each.begin_s >= 60 for each in data.acquisitions)


# What can be wrong with the readings


@pytest.mark.parametrize(("missing", "other"), [("up", "down"), ("down", "up")])
def test_one_end_alone_gives_its_equation_and_nothing_of_the_unit(data, missing, other):
    unit, found = reduced(data, by_end(data, missing))
    assert unit.verdict == "INCOMPLETE"
    assert (unit.left_out, f"end_{missing}_missing" in texts(unit.flags)) == ((f"+Z {missing}",), True)
    assert not {"K0", "K1", "misalignment"} & set(found)
    assert [model.quantity for model in unit.models] == [f"acceleration_{other}"]


def test_without_a_clocking_the_tilt_is_in_the_uncertainty(data):
    unit, found = reduced(data, [each for each in data.acquisitions if "/clocking/" not in each.step])
    assert "no_clocking" in texts(unit.flags)
    assert "b5" not in found
    assert found["K0"].u > 20e-6


def test_unstable_readings_are_left_out_and_told(data):
    first, *others = data.acquisitions
    unit, _ = reduced(data, [dataclasses.replace(first, stable=frozenset()), *others])
    assert "did not become stable in the time" in flag_in_words(flag_of(unit.flags, f"{first.step}: unstable"))
    assert unit.detail.attempts[-1].found.excluded["unstable"] == 1


def test_readings_at_the_limit_of_the_output_are_never_fitted(data):
    unit, found = reduced(data, output_limit_g=7e-3)
    assert "8 readings: saturated" in texts(unit.flags)
    assert found["K1"].value == pytest.approx(1000, rel=0.02)


def test_a_platform_that_is_known_stands_in_b4(data):
    _, found = reduced(data, platform_rad=20e-6, platform_u_rad=5e-6)
    assert found["b4"].value == pytest.approx(20e-6 * found["K1"].value, rel=1e-9)
    _, before = reduced(data)
    assert before["b5"].value - found["b5"].value == pytest.approx(found["b4"].value, rel=1e-6)
    assert found["K0"].value == before["K0"].value


# Mistakes that the comparison with the truth must see


def swapped_ends():
    honest = indexing_readings.readings_of

    def mistaken(data, unit):
        readings, flags = honest(data, unit)
        other = {"up": "down", "down": "up"}
        return [dataclasses.replace(each, end=other[each.end]) for each in readings], flags

    return mock.patch.object(indexing_static, "readings_of", mistaken)


def angles_the_wrong_way_round():
    honest = indexing_readings.readings_of

    def mistaken(data, unit):
        readings, flags = honest(data, unit)
        return [dataclasses.replace(each, angle_rad=-each.angle_rad) for each in readings], flags

    return mock.patch.object(indexing_static, "readings_of", mistaken)


@pytest.mark.parametrize(("plant", "quantity"), [(swapped_ends, "misalignment"), (angles_the_wrong_way_round, "K1")])
def test_a_planted_mistake_is_seen(volts, data, plant, quantity):
    truth = {comparison.quantity: comparison.truth for comparison in compare_indexing(volts.path)}
    with plant():
        _, found = reduced(data)
    assert abs(found[quantity].value - truth[quantity]) > 20 * found[quantity].u


# From which side the unit comes to an angle

NO_RANGE = ("indexing.yaml", "    range: 10 mg\n", "")
HYSTERETIC = ("uut/micro_g.yaml", "  drift: {mean", f"  {INPUT_HYSTERESIS}\n  drift: {{mean")


def both_passes_from_below(folder):
    """The sequence with an approach from below in both passes."""
    text = (ROOT / "sequences" / "indexing_static.yaml").read_text("utf-8")
    for way in ("forward", "reverse"):
        to = f"to: ${{sign * {way}}}\n"
        assert to in text
        text = text.replace(to, f"{to}                    approach: from_below\n", 1)
    path = folder / "from_below.yaml"
    path.write_text(text, "utf-8")
    return path


def noted_moves():
    """Where the head is sent, noted in the world that is moved."""
    sent_deg, honest = [], World.move

    def move(world, target_deg, *args, **named):
        sent_deg.append(target_deg)
        honest(world, target_deg, *args, **named)

    return sent_deg, mock.patch.object(World, "move", move)


def test_the_loop_of_a_unit_with_hysteresis_is_found_without_an_excursion_beyond_the_largest_angle(tmp_path):
    sent_deg, noting = noted_moves()
    with noting:
        run = calibrated(tmp_path, "indexing", (*SHORT, "max_repeats=0"), [HYSTERETIC])
    assert run.problems == []
    assert (min(sent_deg), max(sent_deg)) == (-0.5, 0.5)
    found = {finding["quantity"]: finding for finding in read_json(run, "results.json")["findings"]}
    hysteresis = found["hysteresis"]
    assert hysteresis["u"] < 1e-6
    assert hysteresis["value"] == pytest.approx(2 * 20e-6, abs=3 * hysteresis["u"]), (
        "at 0° the loop is open by all of it"
    )
    comparisons = {each.quantity: each for each in compare_indexing(run.path)}
    assert max(abs(each.ratio) for each in comparisons.values()) < 3.5
    assert comparisons["hysteresis"].truth == pytest.approx(40e-6, rel=0.01)


def test_what_came_to_every_angle_from_below_is_not_called_hysteresis(tmp_path):
    path = both_passes_from_below(tmp_path)
    options = {"settings": (*SHORT, "max_repeats=0"), "sequence": path}
    with pytest.raises(InputError, match=r"to 0\.0\d+ g, and its range is ±0\.01 g"):
        calibrated(tmp_path / "refused", "indexing", edits=[HYSTERETIC], **options)
    run = calibrated(tmp_path, "indexing", edits=[HYSTERETIC, NO_RANGE], no_report=False, **options)
    assert run.problems == []
    results = read_json(run, "results.json")
    assert "hysteresis" not in {finding["quantity"] for finding in results["findings"]}
    assert "hysteresis:equal_histories" in results["units"][0]["flags"]
    assert results["verdict"] == "INCOMPLETE"
    assert "approached every angle from the same side" in (run.path / "report.html").read_text("utf-8")


def test_the_record_tells_from_where_the_head_came_and_while_it_stood(data):
    swept = [each for each in data.acquisitions if "end=up/sign=1/" in each.step]
    assert [each.came_from["head"] for each in swept] == ["below"] * 4 + ["above"] * 2
    assert len({each.stand for each in swept}) == 5, "it does not move where it turns back"
    clocked = [each for each in data.acquisitions if "/clocking/" in each.step]
    assert len({each.stand for each in clocked}) == 1


# Decisions in a run


def test_ends_that_differ_are_measured_again_and_then_marginal(tmp_path):
    coupled = ("uut/micro_g.yaml", "Kip: {mean: 0 µg/g², sd: 10 µg/g²}", "Kip: 500 µg/g²")
    run = calibrated(tmp_path, "indexing", (*SHORTEST, "max_repeats=1"), [coupled], no_report=False)
    assert run.problems == []
    with RunReader(run.path) as reader:
        decisions = [event.data["value"] for event in reader.events("step_ended") if event.data.get("as") == "decision"]
    assert decisions == ["repeat", "repeat", "marginal"]
    found = {finding["quantity"]: finding for finding in read_json(run, "results.json")["findings"]}
    assert found["scale_difference"]["flags"] == ["ends_differ"]
    assert found["Kip"]["value"] == pytest.approx(500e-6, abs=4 * found["Kip"]["u"])
    page = (run.path / "report.html").read_text("utf-8")
    assert "The scale factors of both ends still differ after 2 attempts." in page


def test_what_does_not_become_stable_is_not_fitted(tmp_path):
    restless = (*SHORTEST, "max_repeats=0", "stable_sd=0.001 µg", "stable_by=1 min")
    run = calibrated(tmp_path, "indexing_pulses", restless)
    assert run.problems == []
    results = read_json(run, "results.json")
    assert results["verdict"] == "INCOMPLETE"
    assert sum(flag.endswith(": unstable") for flag in results["units"][0]["flags"]) > 10


def test_the_bench_must_say_what_1_g_is(tmp_path):
    bench = full_bench(tmp_path, "indexing")
    bench.write_text(bench.read_text("utf-8").replace("resistor: 1 kΩ, ", ""), "utf-8")
    with pytest.raises(InputError, match=r"places\.a of the bench file has no nominal K1 and resistor"):
        run_short(tmp_path / "runs", bench=bench, sequence="indexing_static")


def test_the_files_say_the_same_bench():
    volts, pulses = ((ROOT / "config" / f"{name}.yaml").read_text("utf-8") for name in ("indexing", "indexing_pulses"))
    same = volts.partition("fixture:")[2].partition("places:")[0]
    assert same == pulses.partition("fixture:")[2].partition("places:")[0]


def sheets(unit):
    """The tables of a unit by their titles."""
    shown_of = indexing_shown.indexing_shown(unit, "a")
    return {each.title: each for each in shown_of if isinstance(each, Sheet)}


def test_the_tables_of_the_ends_have_the_uncertainties_of_the_results(data):
    unit, found = reduced(data)
    constants = {
        model.quantity.removeprefix("acceleration_"): {
            name: pytest.approx(2 * constant.u, rel=0.05) for name, constant in model.constants.items()
        }
        for model in unit.models
    }
    ends, attempts = sheets(unit)["The two ends"], sheets(unit)["Scale factors of both ends"]
    linearity = [shown(each) for each in unit.findings if each.quantity == "linearity"]
    for row, end in zip(ends.rows, ("up", "down"), strict=True):
        assert float(row[2].partition(" ± ")[2]) == constants[end]["b"]
        assert float(row[3].partition(" ± ")[2]) == constants[end]["K1"]
    assert [row[5] for row in ends.rows] == linearity
    assert max((row[6] for row in ends.rows), key=float) == shown(found["hysteresis"]).split(" ")[0]
    assert ends.heads[6] == ("Hysteresis", "µg")
    (row,) = attempts.rows
    assert row[1:4] == (ends.rows[0][3], ends.rows[1][3], shown(found["scale_difference"]))
    assert "earlier attempts" not in attempts.caption


def test_an_attempt_that_does_not_count_tells_what_its_uncertainty_leaves_out(data):
    unit, found = reduced(data)
    (attempt,) = unit.detail.attempts
    twice = dataclasses.replace(unit, detail=dataclasses.replace(unit.detail, attempts=(attempt, attempt)))
    attempts = sheets(twice)["Scale factors of both ends"]
    earlier, last = attempts.rows
    both = attempt.found.both
    u_ppm = 2e6 * both.scale_difference_v_per_g.u / both.scale_v_per_g.value
    assert earlier[3].endswith(f"± {u_ppm:.0f}")
    assert last[3] == shown(found["scale_difference"])
    assert "For earlier attempts it covers only the residuals of each line" in attempts.caption


def test_an_equation_is_valid_to_hundredths_of_a_degree(data):
    unit, _ = reduced(data)
    low_c, high_c = unit.models[0].valid["temperature_c"]
    assert f"temperature / °C {low_c:.2f} to {high_c:.2f}." in model_sheet(unit.models[0]).caption


@pytest.mark.parametrize("name", ["en", pytest.param("zh", marks=pytest.mark.peer("a Chinese font"))])
def test_the_legends_above_the_residuals_are_inside_the_figure(data, monkeypatch, name):
    figures = {}
    rendered = indexing_shown.rendered
    monkeypatch.setattr(
        indexing_shown,
        "rendered",
        lambda figure, key, title: figures.update({key: figure}) or rendered(figure, key, title),
    )
    unit, _ = reduced(data)
    with language(name), drawing():
        list(indexing_shown.indexing_shown(unit, "a"))
        figure = figures["a-residuals"]
        tops = [axes.get_legend().get_frame().get_window_extent().ymax for axes in figure.axes]
    assert max(tops) < figure.bbox.ymax - 1


def test_a_unit_of_the_other_sign_differs_in_its_sign_alone(volts, pulses):
    assert [*differences(volts.path), *differences(pulses.path)] == []


def test_what_names_a_temperature_has_its_thermometer_in_its_budget(data):
    _, found = reduced(data)
    u_c = data.bench.temperature_u_c("unit_temperature", found["K1"].at["at_c"])
    of = {
        name: next(iter(line.u for line in each.budget if line.source == "unit_temperature: offset, gain"), 0.0)
        for name, each in found.items()
    }
    assert of["K0"] == pytest.approx(SETTINGS["bias_per_c_u"] * u_c)
    assert of["K1"] == pytest.approx(6e-5 * u_c * abs(found["K1"].value))
    assert of["bias_corrected"] == pytest.approx(of["K0"] * abs(found["K1"].value))
    assert of["scale_difference"] == of["misalignment"] == 0.0, "those of both ends are at one temperature"
