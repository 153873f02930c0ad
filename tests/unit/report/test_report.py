"""The report of a run, as it is written: real runs in virtual time, their pages parsed."""

import json
import math
import re
import shutil
import sqlite3
from contextlib import closing
from html.parser import HTMLParser
from xml.etree import ElementTree

import numpy as np
import pytest

from bench.app.execute import execute
from bench.app.request import RunRequest, prepare
from bench.cli.exits import of_run
from bench.figures.sheet import Sheet
from bench.figures.svg import as_document, drawing, new_figure
from bench.figures.words import where
from bench.metrology.results.flag import Flag
from bench.reduce.journal import Measurement
from bench.reduce.spans import Span
from bench.reduce.stored_run import open_run
from bench.report.course import BINS, Course, _draw_phases, course_of
from bench.report.flag_words import flag_in_words
from bench.report.page import simulated
from bench.report.terminal import results_text
from bench.report.write import write_report
from bench.runner.quiet import Quiet
from bench.store.envelope import envelope
from tests.support.runs import ROOT, copy_bench, read_json, run_short, sealed_anew
from tests.support.shared_runs import SMOKE

SCRIPT = "<script>alert(1)</script>"
SHOWN_FACTORS = {
    "K0": 1e6, "K1": 1, "K1_si": 1, "K2": 1e6, "misalignment": 1e6, "tilt/uncompensated": 1, "tilt/compensated": 1,
}  # fmt: skip
VALUE = re.compile(r"(-?\d+(?:\.\d+)?) ± (\d+(?:\.\d+)?)")


class Page(HTMLParser):
    """A page taken apart: its tags with their attributes, and its words, all of them and by part of the page."""

    def __init__(self, html):
        super().__init__()
        self.html, self.tags, self.ids, self.text, self.parts = html, [], [], "", {}
        self._open, self._part = [], None
        self.feed(html)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.handle_startendtag(tag, attributes)
        self._open.append(tag)
        if tag in ("section", "header", "div"):
            attributes = dict(attributes)
            self._part = attributes.get("id") or attributes.get("class") or tag

    def handle_startendtag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        self.ids += [value for name, value in attributes if name == "id"]

    def handle_endtag(self, tag):
        assert self._open.pop() == tag, (tag, self.getpos())

    def handle_data(self, data):
        if "style" not in self._open and data.strip():
            words = " ".join(data.split()) + " "
            self.text += words
            self.parts[self._part] = self.parts.get(self._part, "") + words

    def count(self, tag):
        return sum(found == tag for found, _ in self.tags)


def page_of(folder):
    return Page((folder / "report.html").read_text("utf-8"))


def copy_of(run, folder, **manifest):
    """A run's directory once more, with another manifest and its report written anew."""
    shutil.copytree(run.path, folder / "copy")
    path = folder / "copy" / "manifest.json"
    path.write_text(json.dumps({**json.loads(path.read_text("utf-8")), **manifest}), "utf-8")
    return folder / "copy"


def rewritten(folder):
    with open_run(sealed_anew(folder)) as stored:
        return Page(write_report(stored).read_text("utf-8"))


def run_reported(folder, **wishes):
    """The smoke sequence with its report."""
    return run_short(folder, no_report=False, **{"sequence": "smoke", **wishes})


def run_limited(folder, limits):
    """The smoke sequence with other limits."""
    text = (ROOT / "sequences" / "smoke.yaml").read_text("utf-8")
    sequence = folder / "limited.yaml"
    sequence.write_text(text[: text.index("    limits:")] + f"    limits: {limits}\n", "utf-8")
    return execute(prepare(RunRequest(str(sequence), bench=str(ROOT / "config/simulated.yaml"), runs=folder)), Quiet())


@pytest.fixture
def tumble(tumble_run):
    """Three dwells, up and down."""
    return tumble_run


@pytest.fixture
def smoke(smoke_run):
    return smoke_run


# What the page is


@pytest.mark.lengthy
def test_it_is_one_file_that_refers_to_nothing_elsewhere(tumble):
    page = page_of(tumble.path)
    assert page.html.startswith('<!doctype html>\n<html lang="en">')
    assert "http" not in page.html
    assert not {"script", "link", "img", "iframe", "object"} & {tag for tag, _ in page.tags}
    assert all("src" not in attributes for _, attributes in page.tags)
    assert all(attributes.get("href", "#").startswith("#") for _, attributes in page.tags)
    assert set(re.findall(r"url\((.)", page.html)) == {"#"}
    assert "@import" not in page.html
    assert len(page.html) < 1_500_000


def test_its_ids_are_its_own_and_every_reference_finds_one(tumble):
    page = page_of(tumble.path)
    assert len(page.ids) == len(set(page.ids))
    referred = set(re.findall(r'(?:href="|url\()#([\w-]+)', page.html))
    assert referred
    assert referred <= set(page.ids)


def test_names_that_look_like_markup_are_text(tmp_path):
    page = page_of(run_reported(tmp_path, units=(SCRIPT,), operator=SCRIPT).path)
    assert page.count("script") == 0
    assert f"Operator {SCRIPT}" in page.text
    assert f"{SCRIPT} in place a" in page.text


def test_no_number_is_missing(tumble, smoke):
    for run in (tumble, smoke):
        page = page_of(run.path)
        assert re.findall(r"\b(nan|NaN|None|inf|Infinity|Undefined)\b", page.text) == []
        assert "NaN" not in page.html


def test_equal_runs_give_equal_pages(smoke, tmp_path):
    again = run_reported(tmp_path, **SMOKE)
    first, second = (
        run.path.joinpath("report.html").read_text("utf-8").replace(run.path.name, "RUN").splitlines()
        for run in (smoke, again)
    )
    different = [a for a, b in zip(first, second, strict=True) if a != b]
    assert all(re.match("<dt>(Issued|Started|Ended|Duration|Record)</dt>", line) for line in different)


# What it says


def test_the_verdict_stands_on_top_as_a_word(tumble):
    page = page_of(tumble.path)
    assert ("div", {"class": "verdict PASS"}) in page.tags
    assert page.text.index("PASS") < page.text.index("The run")
    assert "alert" not in page.parts


def test_every_finding_is_there_with_the_digits_that_its_uncertainty_justifies(tumble):
    shown = [(float(v), float(u), len(u.partition(".")[2])) for v, u in VALUE.findall(page_of(tumble.path).text)]
    for finding in read_json(tumble, "results.json")["findings"]:
        factor = SHOWN_FACTORS.get(finding["quantity"], 1e6)
        value, expanded = finding["value"] * factor, finding["expanded"] * factor
        digits = max(0, 1 - math.floor(math.log10(expanded)))
        tolerance = 0.5001 * 10**-digits
        assert any(
            abs(v - value) <= tolerance and abs(u - expanded) <= tolerance and decimals == digits
            for v, u, decimals in shown
        ), finding["id"]


def test_each_limit_has_its_line_with_the_worst_of_the_dwells(tumble):
    text = page_of(tumble.path).parts["verdicts"]
    for quantity, limits in {
        "K0 bias": "-5000 to 5000",
        "K0: temperature coefficient": "-50 to 50",
        "K0: hysteresis": "at most 200",
        "K1: temperature coefficient": "-150 to 150",
        "K2 + asymmetry": "-100 to 100",
        "misalignment": "-5000 to 5000",
    }.items():
        assert re.search(rf"{re.escape(quantity)}[^±]* ± [\d.]+ \S+ {limits} PASS", text), quantity
    assert re.search(r"dwell \d, (cycle \d, )?set point [23]0 °C, \w+ worst of 3 dwells; all passed", text)


def test_models_budgets_and_what_cannot_be_separated_are_told(tumble):
    page = page_of(tumble.path)
    model = read_json(tumble, "results.json")["models"][0]
    assert f"centre {model['centre']:.6f} °C, scale {model['scale']:.6f} °C" in page.text
    assert f"{model['powers_of_T'][1] * 1e6:.9g}" in page.text
    assert "part of the value; this method cannot separate it, and u does not include it" in page.text
    assert "contains the asymmetry of converter or voltmeter" in page.text
    assert page.text.count("combined") == 5 + 13 + 5  # of the first dwell, over the run, of all dwells
    assert page.count("svg") == 6


def test_bench_instruments_and_provenance_are_named(tumble):
    page = page_of(tumble.path)
    manifest = read_json(tumble, "manifest.json")
    for text in (
        "34.25°, 420 m", "9.79541 m/s² ± 0.00040 m/s² (k = 2), model", "SIM-CUBE-01", "Simulated: every instrument.",
        "SIM-2026-0103", "due 2030-12-31", "stated, not verified", "KEITHLEY INSTRUMENTS INC. MODEL 6220", "method M4a",
        manifest["digest"], manifest["hashes"]["bench.yaml"], manifest["run"], "latches in 24 acquisitions, 0 lost",
        "schema: itb-sequence/1", "schema: itb-bench/1", "Tested", "Checked", "Approved", "Simple acceptance",
        "conformity to them is not claimed",
    ):  # fmt: skip
        assert text in page.text, text
    with open_run(tumble.path) as stored:
        frames = sum(len(block) for _, _, block in stored.reader.blocks())
    assert f"Frames recorded {frames} " in page.text


def test_a_result_outside_its_limits_fails_and_one_close_to_them_is_marginal(tmp_path):
    run = run_limited(tmp_path, "{K0: {max: 0.5 mg}, misalignment: {max: 320 µrad}, K2: {min: 1 µg/g²}}")
    page = page_of(run.path)
    assert ("div", {"class": "verdict FAIL"}) in page.tags
    text = page.parts["verdicts"]
    assert re.search(r"K0 bias of the channel \d+ ± \d+ ! µg at most 500 FAIL dwell 0", text)
    assert re.search(r"misalignment .* at most 320 PASS marginal", text)
    assert re.search(r"K2 \+ asymmetry .* at least 1 PASS dwell 0", text)
    assert "K0 FAIL; misalignment marginal" in page.text


def test_limits_stand_in_the_report_as_they_are_declared_and_why_a_value_was_not_accepted(tmp_path):
    k1 = "K1: {target: 11300 pulse/s/g, relative: 0.5 %, guard: 2, marginal: 5 pulse/s/g}"
    run = run_limited(tmp_path, f"{{{k1}, misalignment: {{max: 320 µrad, guard: 2}}}}")
    page = page_of(run.path)
    text = page.parts["verdicts"]
    assert re.search(r"K1 per local g .* pulse/s/g 11300 ± 56.5 guard band 2 u, marginal within 5 PASS dwell 0", text)
    assert re.search(r"µrad at most 320 guard band 2 u FAIL marginal dwell 0.* inside its limits, but within", text)
    assert "misalignment: inside its limits, but within their guard band" in page.parts["unit-a-0"]
    assert "JCGM 106" in page.parts["meaning"]
    reported = results_text(run.results)
    assert re.search(
        r"K1 per local g +\d+\.\d+ ± \d\.\d+ +pulse/s/g +PASS +11300 ± 56.5; guard band 2 u, marg", reported
    )
    assert re.search(r"misalignment .* FAIL marginal +at most 320; guard band 2 u; inside its limits, but", reported)
    (found,) = [found for found in read_json(run, "results.json")["findings"] if found["quantity"] == "misalignment"]
    assert (found["limits"], found["guard"], found["verdict"]) == ({"max": 320e-6}, 2, "FAIL")
    assert found["flags"] == ["guard_band"]


def test_a_dwell_that_was_left_out_and_a_limit_that_nothing_could_be_held_against(tmp_path):
    run = run_reported(tmp_path, settings=("positions=[0°, 90°, 180°, 180.01°]",))
    page = page_of(run.path)
    assert ("div", {"class": "verdict INCOMPLETE"}) in page.tags
    assert "Dwell 0 is left out: no usable reading near these angles in °: 270." in page.parts["note"]
    assert re.search("K0 not determined µg -5000 to 5000 not judged", page.parts["verdicts"])
    assert "There are too few data for a figure" in page.text


def test_a_model_without_degrees_of_freedom_has_no_residuals_to_draw(tmp_path):
    run = run_reported(tmp_path, settings=("temperatures=[20 °C, 22 °C]",))
    page = page_of(run.path)
    assert "K0: straight line" in page.text
    assert "Residual standard deviation not known with 0 degrees of freedom" in page.text
    assert "Residuals of" not in page.text
    assert page.parts["models"].count("not known") == 6


def test_two_dwells_at_one_temperature_are_drawn_without_a_model(tmp_path):
    run = run_reported(tmp_path, settings=("temperatures=[20 °C, 20 °C]",))
    page = page_of(run.path)
    assert "Bias K0, over temperature." in page.text
    assert "Models over temperature" not in page.text
    assert "K0: its temperature dependence is unknown" in page.parts["note"]


def test_each_unit_has_its_sections(tmp_path):
    bench = copy_bench(
        tmp_path / "config",
        ("monitor:\n", "  b: {channel: y, temperature: unit_temperature, supply: supply}\n\nmonitor:\n"),
        ("units: {a: uut/quartz_flexure.yaml}", "units: {a: uut/quartz_flexure.yaml, b: uut/quartz_flexure.yaml}"),
        ("max: 110 mA", "max: 130 mA"),
        ("certificate: SIM-2026-0101, laboratory: none, date: 2026-01-01, due: 2030-12-31",
         "certificate: SIM-2025-0101, laboratory: none, date: 2025-01-01, due: 2025-12-31"),
    )  # fmt: skip
    run = run_reported(tmp_path, bench=bench, units=("a=QF-1", "b=QF-2"), past_due="mark")
    page = page_of(run.path)
    assert {"unit-a-0", "unit-b-1"} <= set(page.ids)
    assert "QF-2: No dwell has more readings than unknowns" in page.parts["note"]
    assert "head: its calibration was due on 2025-12-31, before this run." in page.parts["note"]
    assert "due 2025-12-31 past due" in page.text


# Runs that did not get to their end


def test_a_bench_that_failed_says_why_on_top(tmp_path):
    bench = copy_bench(tmp_path / "config", faults="[{device: counter, kind: silent, at: 40 s}]")
    run = run_reported(tmp_path, bench=bench)
    page = page_of(run.path)
    assert ("div", {"class": "verdict ERROR"}) in page.tags
    assert run.problems[0] in page.parts["alert"]
    assert "ended by a problem of the bench" in page.parts["alert"]
    assert "Not completed: step steps/temperature=20/" in page.parts["alert"]
    assert "the run deviated from its plan" in page.text
    assert "Verdict on what was measured" in page.text


def test_a_bench_that_could_not_be_opened(tmp_path):
    bench = copy_bench(tmp_path / "config", faults="[{device: head, kind: silent, at: 0 s}]")
    run = run_reported(tmp_path, bench=bench)
    page = page_of(run.path)
    assert ("div", {"class": "verdict ERROR"}) in page.tags
    assert run.problems[0] in page.parts["alert"]
    assert "course" not in page.ids


def test_a_device_that_was_not_made_safe_comes_first(smoke, tmp_path):
    folder = copy_of(smoke, tmp_path, state="error", verdict="ERROR", problems=["power"], unsafe={"chamber": "silent"})
    alert = rewritten(folder).parts["alert"]
    assert alert.index("chamber COULD NOT BE MADE SAFE: silent") < alert.index("power")


def test_a_run_that_the_operator_ended(smoke, tmp_path):
    page = rewritten(copy_of(smoke, tmp_path, state="aborted", verdict="ABORTED", problems=["ended by the operator"]))
    assert ("div", {"class": "verdict ABORTED"}) in page.tags
    assert "ended by the operator" in page.parts["alert"]


def test_a_run_that_was_interrupted_is_told_from_its_journal(smoke, tmp_path):
    not_yet = dict.fromkeys(("verdict", "ended", "wall_s", "bench_s"))
    folder = copy_of(smoke, tmp_path, state="running", instruments={}, problems=[], **not_yet)
    manifest = json.loads((folder / "manifest.json").read_text("utf-8"))
    del manifest["digest"], manifest["unsafe"]
    (folder / "manifest.json").write_text(json.dumps(manifest), "utf-8")
    with closing(sqlite3.connect(folder / "run.db")) as database, database:
        database.execute("DELETE FROM journal WHERE seq > (SELECT seq FROM journal WHERE step LIKE '%=90/acquire')")
        database.execute("DELETE FROM reading WHERE at_s > (SELECT MAX(at_s) + 20 FROM journal)")
    database.close()
    page = rewritten(folder)
    assert ("div", {"class": "verdict INCOMPLETE"}) in page.tags
    assert "It was interrupted" in page.parts["alert"]
    assert "Not completed: step steps/temperature=20/position=90/acquire." in page.parts["alert"]
    assert "Watlow F4T" in page.text
    assert "not recorded" in page.text
    assert "not computed" in page.text


def test_data_that_cannot_be_evaluated_are_no_reason_for_no_report(smoke, tmp_path):
    folder = copy_of(smoke, tmp_path)
    (folder / "if_counter.dbc").unlink()
    page = rewritten(folder)
    assert "cannot be decoded" in page.parts["alert"]
    assert "There are no results." in page.text
    assert page.count("svg") == 1  # the course of the run


def test_a_verdict_that_has_become_another_is_told(smoke, tmp_path):
    page = rewritten(copy_of(smoke, tmp_path, verdict="FAIL"))
    assert "The run ended with the verdict FAIL; re-evaluated now, it is PASS." in page.parts["alert"]


def test_a_report_that_cannot_be_written_takes_no_results_away(tmp_path, monkeypatch):
    def refuse(run):
        raise OSError("the disk is full")

    monkeypatch.setattr("bench.report.write.write_report", refuse)
    run = run_reported(tmp_path)
    assert run.results.verdict == "PASS"
    assert (run.report, of_run(run)) == (None, 3)
    assert run.problems == [f"no report could be written (the disk is full); 'bench report {run.path}' tries again"]
    assert read_json(run, "results.json")["verdict"] == read_json(run, "manifest.json")["verdict"] == "PASS"


# Words and curves


@pytest.mark.parametrize(
    ("flag", "words"),
    [
        (
            Flag("dwell {number} incomplete: {angles}", values={"number": 3, "angles": "90, 270"}),
            "Dwell 3 is left out: no usable reading near these angles in °: 90, 270.",
        ),
        (
            Flag("dwell {number} incomplete: ill_conditioned", values={"number": 3}),
            "Dwell 3 is left out: its readings do not determine the four unknowns.",
        ),
        (
            Flag("too_few_latches", at="steps/temperature=20/position=0/acquire"),
            "A reading is left out: fewer than half of its counter readings arrived "
            "(steps/temperature=20/position=0/acquire).",
        ),
        (Flag("ill_conditioned", of="K1"), "K1: the temperatures do not determine the model."),
        (Flag("its own words", at="of a plug-in"), "of a plug-in: its own words"),
    ],
)
def test_flags_are_sentences(flag, words):
    assert flag_in_words(flag) == words


def test_conditions_are_words():
    assert (
        where({"dwells": ["a", "b"], "temperature_set_c": 20.0}, {"a": 4, "b": 7}) == "dwells 4 and 7, set point 20 °C"
    )
    assert where({"label": "x"}, {}) == ""


def test_some_instruments_may_be_simulated():
    roles = ["chamber", "head", "counter"]
    assert simulated({"simulated": roles}, roles) == "every instrument"
    assert simulated({"simulated": ["counter", "chamber"]}, roles) == "chamber, counter"
    assert simulated({"simulated": []}, roles) == ""


def test_a_spike_of_one_sample_survives_the_reduction_of_a_curve():
    at_s = np.arange(100_000.0)
    values = np.sin(at_s / 9000)
    values[[0, 54_321, 99_999]] = -3.0, 7.0, 5.0
    parts = np.array_split(np.stack([at_s, values], axis=-1), 7)
    reduced_s, reduced = envelope(parts, (at_s[0], at_s[-1]), BINS)
    assert len(reduced) == len(reduced_s) == 2 * BINS
    assert reduced[0] == -3.0
    assert reduced.max() == 7.0
    assert abs(reduced_s[np.argmax(reduced)] - 54_321) < 100
    assert reduced[-1] == 5.0


def test_a_gap_in_time_is_a_gap_in_the_curve():
    at_s = np.concatenate([np.arange(5000.0), np.arange(20_000.0, 25_000.0)])
    reduced_s, reduced = envelope([np.stack([at_s, np.ones_like(at_s)], axis=-1)], (at_s[0], at_s[-1]), BINS)
    missing = reduced_s[np.isnan(reduced)]
    assert 4999 < missing.min() < 5100
    assert 19_900 < missing.max() < 20_000


def test_columns_of_words_stand_at_the_left_and_those_of_numbers_at_the_right():
    heads = (("", ""),) * 5
    rows = (("1", "2 ± 1", "yes", "", "not known"), ("2", "–", "no", "", "0.5"))
    assert Sheet("", "", heads, rows).aligned == ("", "n", "", "", "n")
    assert Sheet("", "", heads, ()).aligned == ("",) * 5


@pytest.mark.parametrize(
    ("limits", "shown"),
    [
        ({"min": 64.8, "max": 65.2}, "64.8 to 65.2 °C"),
        ({"min": None, "max": 65.2}, "at most 65.2 °C"),
        ({"min": 64.8, "max": None, "guard": 2.0}, "at least 64.8 °C, guard band 2 u"),
    ],
)
def test_limits_of_a_single_measurement(limits, shown):
    measured = Measurement("step", "reading", None, 65.0, "°C", 0.1, limits, "PASS", marginal=False)
    assert measured.limits_shown == shown


def test_numbers_of_dwells_are_not_written_over_each_other():
    begin_s = {12: 900.0, 10: 10.0, 11: 12.0, 7: 500.0, 8: 517.0}
    assert written(*(Span(f"{number}", at_s, at_s + 1) for number, at_s in begin_s.items())) == ["10", "7", "12"]


def test_what_has_no_name_is_not_written_and_takes_no_room():
    assert written(Span("", 500.0, 501.0), Span("skew", 501.0, 502.0)) == ["skew"]


def test_names_at_the_ends_of_a_run_stay_in_the_picture():
    strip = new_figure(1.0).subplots()
    spans = (Span("closure", 0.0, 1.0), Span("closure", 999.0, 1000.0))
    _draw_phases(strip, Course(0.0, 1000.0, (), spans, (), None), 1.0)
    at = [text.get_position()[0] for text in strip.texts]
    assert at[0] == pytest.approx(1000 - at[1])
    assert 15 < at[0] < 50


def test_a_figure_is_a_document_whatever_its_texts():
    figure = new_figure(1.0)
    figure.text(0.5, 0.5, "a\x0b<b>&")
    with pytest.warns(UserWarning, match="Glyph 11 .* missing"), drawing():
        (text,) = ElementTree.fromstring(as_document(figure)).iter("{http://www.w3.org/2000/svg}text")
    assert "".join(text.itertext()) == "a\ufffd<b>&"


def written(*spans):
    """The names above a run of 1000 s, from left to right."""
    strip = new_figure(1.0).subplots()
    _draw_phases(strip, Course(0.0, 1000.0, (), spans, (), None), 1.0)
    return [text.get_text() for text in sorted(strip.texts, key=lambda text: text.get_position()[0])]


def test_the_course_of_a_run_reads_only_what_it_shows(smoke, monkeypatch):
    read = []
    with open_run(smoke.path) as run:
        events = run.reader.events

        def counted(*kinds):
            for event in events(*kinds):
                read.append(event.kind)
                yield event

        monkeypatch.setattr(run.reader, "events", counted)
        course = course_of(run, [])
    assert set(read) == {"step_begins", "made_safe"}
    assert {"setup", "steps", "teardown"} <= {phase.name for phase in course.phases}
