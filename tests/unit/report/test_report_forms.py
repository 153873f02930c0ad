"""The report of a run as JSON and as a table."""

import csv
import gc
import io
import json
import re
import sqlite3
from contextlib import closing

import pytest

from bench.errors import StoreError
from bench.reduce.stored_run import open_run
from bench.report.export.csv_cells import harmless
from bench.report.export.export import FORMATS
from bench.report.write import FORMS, NEW_OBJECTS, write_report
from tests.support.runs import read_json, run_short, sealed_anew


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A short run with its report."""
    return run_short(tmp_path_factory.mktemp("forms"), sequence="smoke", units=("QF-0001",), no_report=False)


def report(run, form):
    with open_run(run.path) as stored:
        return write_report(stored, form)


def test_json_is_what_the_run_was_closed_with(run):
    assert json.loads(report(run, "json").read_text("utf-8")) == read_json(run, "results.json")


def test_a_table_has_a_line_for_each_finding(run):
    rows = list(csv.DictReader(io.StringIO(report(run, "csv").read_text("utf-8"))))
    results = read_json(run, "results.json")
    assert len(rows) == len(results["findings"]) + len(results["measurements"])
    for row, finding in zip(rows, results["findings"], strict=False):
        assert (row["id"], row["uut"], row["quantity"]) == (finding["id"], "QF-0001", finding["quantity"])
        assert (float(row["value"]), row["unit"], float(row["u"])) == (finding["value"], finding["unit"], finding["u"])
        assert row["dof"] == ("inf" if finding["dof"] is None else str(finding["dof"]))
        assert float(row["k"]) == finding["k"] >= 2
        assert row["verdict"] == (finding["verdict"] or "")
        assert row["max"] == ("" if finding["limits"] is None else str(finding["limits"]["max"]))
        assert row["flags"].split() == finding["flags"]


FORMULAS = ["=1+2", "+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\t=1", "\r=1", "\uff1d1"]


@pytest.mark.parametrize("text", FORMULAS)
def test_text_is_no_formula_in_a_spreadsheet(text):
    assert harmless(text) == f"'{text}"


@pytest.mark.parametrize("cell", ["-1", "+1.5", "-1.5e-07", "-inf", -1.5, None, "a=b", "", "QF-0001"])
def test_numbers_and_other_text_stay_as_they_are(cell):
    assert harmless(cell) is cell


def test_hostile_names_are_harmless_in_every_csv_file(tmp_path):
    serial = "+cmd|' /C calc'!A0"
    result = run_short(tmp_path, sequence="smoke", units=(serial,), operator="=1+2")
    with open_run(result.path) as stored:
        paths = [write_report(stored, "csv"), *FORMATS["csv"](stored, tmp_path / "out")]
    cells = []
    for path in paths:
        with path.open(encoding="utf-8", newline="") as file:
            cells += [cell for row in csv.reader(file) for cell in row]
    assert f"'{serial}" in cells
    number = re.compile(r"[-+]?[\d.]+(e[-+]?\d+)?")
    assert [cell for cell in cells if cell.startswith(tuple("=+-@\t\r")) and not number.fullmatch(cell)] == []


def test_results_alone_are_nothing_when_the_data_cannot_be_evaluated(run, tmp_path):
    broken = tmp_path / "broken"
    broken.mkdir()
    for path in run.path.iterdir():
        (broken / path.name).write_bytes(path.read_bytes())
    with closing(sqlite3.connect(broken / "run.db")) as database, database:
        database.execute("UPDATE block SET crc = crc + 1")
    database.close()
    with open_run(sealed_anew(broken)) as stored:
        for form in ("json", "csv"):
            with pytest.raises(StoreError, match="is damaged"):
                write_report(stored, form)
        assert "is damaged" in write_report(stored).read_text("utf-8")


def test_every_form_of_a_report_has_its_name(run):
    assert list(FORMS) == ["html", "pdf", "json", "csv"]
    assert report(run, "html").name == "report.html"


def test_garbage_is_seldom_collected_while_a_report_is_written_and_as_before_afterwards(run, monkeypatch, tmp_path):
    before, meanwhile = gc.get_threshold(), []
    monkeypatch.setitem(FORMS, "json", lambda _: meanwhile.append(gc.get_threshold()[0]) or b"")
    with open_run(run.path) as stored:
        write_report(stored, "json", out=tmp_path / "results.json")
        assert meanwhile == [NEW_OBJECTS]
        assert gc.get_threshold() == before
        monkeypatch.setitem(FORMS, "json", lambda _: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            write_report(stored, "json", out=tmp_path / "results.json")
    assert gc.get_threshold() == before
