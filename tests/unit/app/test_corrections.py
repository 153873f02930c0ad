"""Corrections of certificates: what a bench file may say, and what becomes of readings."""

import datetime as dt
import re

import numpy as np
import pytest

from bench.app.drawn import world_settings
from bench.app.laboratory import unit_files
from bench.app.request import RunRequest, load_checked, prepare
from bench.config.bench import load_bench
from bench.errors import InputError
from bench.metrology.acquisition import Voltages
from bench.reduce.corrections import corrections_of
from bench.reduce.stored_run import open_run
from bench.store.reader import Series
from simulators.physics.corrections import correction_deg, read_of
from tests.support.runs import ROOT, copy_bench, read_json, run_short

HEAD_U = "U: {zero: 10 arcsec, harmonics: [2 arcsec, 2 arcsec, 2 arcsec, 2 arcsec], repeatability: 0.2 arcsec}"
ANGLES = "angle: [{at: 0°, add: 10 arcsec}, {at: 90°, add: -20 arcsec}, {at: 360°, add: 10 arcsec}]"
ROWS = "[{at: 0 °C, add: 0.5 °C}, {at: 40 °C, add: -0.3 °C}]"
CLOCK = ("U: {time_base: 1 ppm}", "U: {time_base: 1 ppm}, corrections: {time_base: 5 ppm}")
HEAD = (HEAD_U, f"{HEAD_U}, corrections: {{{ANGLES}}}")
THERMOMETER_U = "U: {offset: 0.6 °C, gain: 0.2 %, drift: 0.12 °C}"
THERMOMETER = (THERMOMETER_U, f"{THERMOMETER_U}, corrections: {ROWS}")
PAST_DUE = ("certificate: SIM-2026-0102, laboratory: none, date: 2026-01-01, due: 2030-12-31",
            "certificate: SIM-2026-0102, laboratory: none, date: 2024-01-01, due: 2025-12-31")  # fmt: skip


@pytest.fixture
def bench(tmp_path):
    return load_bench(copy_bench(tmp_path, CLOCK, HEAD, THERMOMETER)).bench


def series(*values_c):
    values = np.array(values_c)
    return Series("unit_temperature", "°C", np.arange(len(values), dtype=float), values)


def test_a_temperature_is_corrected_by_straight_lines_and_beyond_the_table_by_its_ends(bench):
    known = corrections_of(bench)
    assert known.temperatures(series(-20.0, 0.0, 10.0, 40.0, 70.0)).values == pytest.approx(
        [-19.5, 0.5, 10.3, 39.7, 69.7]
    )
    other = Series("other", "°C", np.zeros(1), np.ones(1))
    assert known.temperatures(other) is other


def test_an_angle_is_corrected_alike_in_every_turn(bench):
    known = corrections_of(bench)
    found = [known.angle_deg("head", at_deg) - at_deg for at_deg in (0.0, 45.0, 90.0, 225.0, 405.0, -315.0)]
    assert np.array(found) * 3600 == pytest.approx([10, -5, -20, -5, -5, -5], abs=1e-6)
    assert known.angle_deg("other", 45.0) == 45.0


def test_the_simulated_instruments_need_what_their_certificates_say(bench):
    known, settings = corrections_of(bench), world_settings(bench, unit_files(bench, None), 1)
    true_c = np.linspace(-60, 90, 301)
    read_c = read_of(true_c, settings.places["a"].thermometer.table)
    assert known.temperatures(series(*read_c)).values == pytest.approx(true_c, abs=1e-9)
    assert not np.allclose(read_c, true_c, atol=0.1)
    read_deg = np.linspace(-400, 800, 97)
    true_deg = read_deg + correction_deg(read_deg, settings.axes["head"].table)
    assert [known.angle_deg("head", each) for each in read_deg] == pytest.approx(true_deg.tolist(), abs=1e-12)


def test_a_voltage_is_corrected_by_gain_and_offset(tmp_path):
    volts = copy_bench(tmp_path).parent / "volts.yaml"
    text = volts.read_text("utf-8")
    at = text.index("U: {gain")
    volts.write_text(text[:at] + "corrections: {gain: 100 ppm, offset: -2 mV}, " + text[at:], "utf-8")
    found = corrections_of(load_bench(volts).bench).voltages("dvm", Voltages(np.zeros(2), np.array([1.0, -1.0])))
    assert found.values_v == pytest.approx([0.9981, -1.0021])


@pytest.mark.parametrize(
    ("edit", "problem"),
    [
        ((ROWS, "[{at: 40 °C, add: 0 °C}, {at: 0 °C, add: 0 °C}]"), "the rows rise, and 0 stands after 40"),
        ((ROWS, "[{at: 0 °C, add: 9 °C}, {at: 4 °C, add: 0 °C}]"), "is corrected to no more than the reading 0"),
        ((ROWS, "[{at: 0 °C, ad: 9 °C}]"), "ad: unknown key; did you mean 'add'?"),
        ((ROWS, "[{at: 0 °C, add: 9 K/s}]"), "add: kelvin is refused"),
        ((ANGLES, "angle: [{at: 0°, add: 0 arcsec}, {at: 370°, add: 0 arcsec}]"), "the rows must lie within one turn"),
        ((ANGLES, "angel: []"), "angel: unknown key; did you mean 'angle'?"),
        (("time_base: 5 ppm", "time_base: 5 s"), "time_base: is in s, expected a number without a unit"),
    ],
)
def test_a_table_that_cannot_be_is_refused(tmp_path, edit, problem):
    path = copy_bench(tmp_path, CLOCK, HEAD, THERMOMETER, edit)
    with pytest.raises(InputError) as refused:
        load_bench(path)
    assert problem in str(refused.value)


# What a report and the results tell


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("corrected")
    bench = copy_bench(folder / "config", CLOCK, HEAD, THERMOMETER, PAST_DUE)
    return run_short(folder, bench=bench, sequence="smoke", past_due="mark", no_report=False)


def test_the_report_tells_each_correction_and_where_a_table_ended(run):
    lines = [
        "unit_temperature: corrected by +0.5 °C at 0 °C, -0.3 °C at 40 °C (certificate SIM-2026-0103).",
        "head: corrected by +10 arcsec at 0°, -20 arcsec at 90°, +10 arcsec at 360° (certificate SIM-2026-0101).",
        "counter: corrected by +5 ppm (certificate SIM-2026-0102).",
    ]
    assert read_json(run, "results.json")["corrections"] == lines
    page = (run.path / "report.html").read_text("utf-8")
    assert all(line in page for line in lines)
    assert "Readings corrected by certificates" in page


def test_readings_beyond_a_table_are_told(tmp_path):
    narrow = (ROWS, "[{at: 0 °C, add: 0.5 °C}, {at: 5 °C, add: 0.5 °C}]")
    bench = copy_bench(tmp_path / "config", CLOCK, HEAD, THERMOMETER, narrow)
    found = run_short(tmp_path, bench=bench, sequence="smoke")
    (line, *_) = read_json(found, "results.json")["corrections"]
    assert "outside the table: there its end values were used." in line


def test_without_corrections_and_past_due_certificates_nothing_is_told(smoke_run):
    assert read_json(smoke_run, "results.json")["corrections"] == []
    assert read_json(smoke_run, "results.json")["past_due"] == {}


def test_what_is_stored_stays_as_it_was_read(run):
    with open_run(run.path) as stored:
        acquired = stored.data("tumble").acquisitions[1]
        read = stored.reader.series("unit_temperature").between(acquired.begin_s, acquired.end_s).values
        (move,) = (each for each in stored.reader.events("step_ended") if each.step.endswith("position=90/move"))
    lacking_c = np.interp(read, [0, 40], [0.5, -0.3])
    assert acquired.temperatures_c["unit_temperature"] == pytest.approx(read + lacking_c)
    assert (acquired.angle_deg - move.data["angle_deg"]) * 3600 == pytest.approx(-20 + 30 * 1 / 270, abs=1e-6)
    assert acquired.counts["x"].tick_period_s == pytest.approx(1e-6 * (1 + 5e-6), rel=1e-12)


# Past due


def test_a_run_with_an_instrument_past_due_is_refused_unless_it_is_marked(tmp_path, run):
    bench = copy_bench(tmp_path, PAST_DUE)
    request = RunRequest("smoke", bench=str(bench), runs=tmp_path)
    warned = [each for each in load_checked(request).warnings if each.rule == "past-due"]
    assert [str(each.text) for each in warned] == [
        "the calibration of 'counter' was due on 2025-12-31; the run is refused. Enter its new certificate "
        "in the bench file, or run with --past-due mark: the report then marks every result [past-due]"
    ]
    lines = bench.read_text("utf-8").splitlines()
    due = next(number for number, line in enumerate(lines, start=1) if "due: 2025-12-31" in line)
    with pytest.raises(InputError, match=rf"^{re.escape(str(bench))}:{due}:\d+: the calibration of 'counter' was due"):
        prepare(request)
    assert read_json(run, "results.json")["past_due"] == {"counter": "2025-12-31"}
    assert "counter: its calibration was due on 2025-12-31, before this run." in (run.path / "report.html").read_text()


def test_an_instrument_that_the_run_does_not_use_may_be_past_due(tmp_path):
    unused = "  source:\n    driver: keithley_6220\n"
    certificate = "    calibration: {certificate: X, laboratory: none, date: 2024-01-01, due: 2025-12-31}\n"
    bench = copy_bench(tmp_path, (unused, unused + certificate))
    assert load_bench(bench).bench.past_due(dt.date(2026, 1, 1)) == {"source": dt.date(2025, 12, 31)}
    assert prepare(RunRequest("smoke", bench=str(bench), runs=tmp_path)).warnings == ()


def test_the_shipped_benches_are_calibrated():
    benches = sorted((ROOT / "config").glob("*.yaml"))
    assert benches
    for path in benches:
        assert load_bench(path).bench.past_due(dt.date(2026, 1, 1)) == {}, path
