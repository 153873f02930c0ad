"""Questions to an archive: SQL, the drift of a unit, two runs side by side, what is due."""

from __future__ import annotations

import csv
from datetime import date, timedelta

import numpy as np
import pytest

from bench.archive.query import opened
from bench.archive.shown import compared_lines, history_lines, written
from bench.archive.units import compared, due, run_of, unit_history
from bench.clock import wall_utc
from bench.errors import InputError
from tests.support.archives import FIRST, PARTITION, fill, findings, with_runs

YEARS = 100 / 365.25  # between two calibrations


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """A unit with a drift of +20 µg a year, one without, and one that reaches its limit soon."""
    rng = np.random.default_rng(7)
    steady = 1e-3 + 1e-6 * rng.standard_normal(8)
    drifting = 1e-3 + 20e-6 * YEARS * np.arange(8) + 1e-6 * rng.standard_normal(8)
    near = 4.9e-3 + 60e-6 * YEARS * np.arange(4)
    units = {"QF-1": steady, "QF-2": drifting, "QF-3": near}
    rows = [row for serial, values in units.items() for row in findings(serial, [float(each) for each in values])]
    folder = tmp_path_factory.mktemp("archive")
    instruments = [
        {
            **{name: row[name] for name in ("uuid", "version", "run", "started", PARTITION)}, "role": "head",
            "maker": "Aerotech", "model": "Ensemble", "serial": "H-1", "simulated": False, "certificate": f"C-{number}",
            "due": wall_utc().date() + timedelta(days=10 * number - 60),
        }
        for number, row in enumerate(findings("QF-1", [0.0] * 8))
    ]  # fmt: skip
    fill(folder, findings=rows, runs=with_runs(rows), instruments=instruments)
    return opened(str(folder))


def test_the_drift_of_a_unit_is_found_with_its_uncertainty(archive) -> None:
    (series,) = unit_history(archive, "QF-2").series
    assert len(series.points) == 8
    assert series.drift is not None
    years = YEARS * (np.arange(8) - 3.5)
    assert series.drift.expanded == pytest.approx(2e-6 / np.sqrt(np.sum(years**2)), rel=1e-6)
    assert abs(series.drift.per_year - 20e-6) < 1.5 * series.drift.expanded
    assert series.drift.significant
    (steady,) = unit_history(archive, "QF-1").series
    assert steady.drift is not None
    assert not steady.drift.significant


def test_errors_that_calibrations_share_neither_hide_nor_pretend_a_drift(tmp_path) -> None:
    """The certificate of the head is a constant error of all three: the difference is that of the rest."""
    rows = findings("QF-1", [1e-3, 1.002e-3, 1.004e-3], u=5e-6, shared='{"head: zero of 0123": 4.9e-6}')
    fill(tmp_path, findings=rows, runs=with_runs(rows))
    (series,) = unit_history(opened(str(tmp_path)), "QF-1").series
    u = np.sqrt(2 * (5e-6**2 - 4.9e-6**2))
    assert series.points[1].e_n == pytest.approx(2e-6 / (2 * u), rel=1e-6)


def test_a_unit_that_is_not_there_is_an_error_with_the_nearest_name(archive) -> None:
    with pytest.raises(InputError, match="no results of a unit 'QF2'; did you mean 'QF-2'"):
        unit_history(archive, "QF2")


def test_a_history_is_shown_in_the_unit_of_reports(archive) -> None:
    lines = list(history_lines(unit_history(archive, "QF-2")))
    assert lines[0].startswith("QF-2: 8 runs, the last ")
    assert any("in µg" in line for line in lines)
    assert any("per year: significant" in line for line in lines)


def test_two_runs_are_compared_by_name_or_uuid(archive) -> None:
    first, last = "QF-2-0000", f"{FIRST + 700 * timedelta(days=1):%Y%m%dT%H%M%SZ}_tumble-static_QF-2"
    (found,) = compared(archive, first, last)
    assert found.difference == pytest.approx(20e-6 * YEARS * 7, abs=5e-6)
    assert found.e_n == pytest.approx(found.difference / (2e-6 * np.sqrt(2)), rel=1e-6)
    assert any("!" in line for line in compared_lines([found]))
    assert run_of(archive, last) == "QF-2-0007"
    with pytest.raises(InputError, match="ambiguous"):
        run_of(archive, "QF-2")
    with pytest.raises(InputError, match="there is no run 'QF-9'"):
        run_of(archive, "QF-9")


def test_results_of_one_run_alone_have_no_difference(tmp_path) -> None:
    rows = findings("QF-1", [1e-3]) + findings("QF-2", [1e-3], result="tumble/K1", unit="pulse/s/g")
    fill(tmp_path, findings=rows, runs=with_runs(rows))
    found = compared(opened(str(tmp_path)), "QF-1-0000", "QF-2-0000")
    assert [(each.first, each.second, each.difference, each.e_n) for each in found] == [
        (1e-3, None, None, None), (None, 1e-3, None, None)
    ]  # fmt: skip


def test_what_is_due_has_the_last_certificate_and_the_drift(archive) -> None:
    found = due(archive, 60)
    assert [each.what for each in found] == ["QF-3", "Aerotech Ensemble H-1"]
    assert found[1].why.startswith("certificate C-7, used in ")
    assert found[1].when == wall_utc().date() + timedelta(days=10)
    assert "K0 may reach its limit" in found[0].why
    assert found[0].when > date(2024, 11, 5)
    assert [each.what for each in due(archive, 5)] == ["QF-3"]


def test_simulated_units_and_instruments_are_due_only_if_asked_for(tmp_path) -> None:
    rows = findings("SIM", [4.9e-3, 4.95e-3, 4.99e-3], simulated=True)
    fill(tmp_path, findings=rows, runs=with_runs(rows))
    archive = opened(str(tmp_path))
    assert due(archive, 10) == []
    assert [each.what for each in due(archive, 10, simulated=True)] == ["SIM"]


def test_a_wrong_question_is_an_error_in_words(archive) -> None:
    with pytest.raises(InputError, match=r"the query 'SELECT nothing FROM runs' cannot be answered: .*nothing"):
        archive.query("SELECT nothing FROM runs")


def test_answers_become_files(archive, tmp_path) -> None:
    sql = "SELECT uut, value FROM findings ORDER BY uut, started"
    with written(archive, sql, tmp_path / "a.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["uut", "value"]
    assert [(uut, float(value)) for uut, value in rows[1:]] == archive.query(sql).rows
    written(archive, sql, tmp_path / "a.parquet")
    assert archive.query(f"SELECT count(*) FROM read_parquet('{tmp_path}/a.parquet')").rows == [(20,)]
    with pytest.raises(InputError, match=r"expected a name that ends in \.csv or \.parquet"):
        written(archive, sql, tmp_path / "a.xlsx")


def test_a_text_that_a_spreadsheet_takes_for_a_formula_is_harmless(archive, tmp_path) -> None:
    path = written(archive, "SELECT '=1+1' AS a", tmp_path / "a.csv")
    assert path.read_text().splitlines()[1].startswith("'=")


def test_rows_of_a_run_that_is_not_published_are_invisible(tmp_path) -> None:
    rows = findings("QF-1", [1e-3, 2e-3])
    fill(tmp_path, findings=rows, runs=with_runs(rows[:1]))
    archive = opened(str(tmp_path))
    assert archive.query("SELECT value FROM findings").rows == [(1e-3,)]
    assert archive.query("SELECT value FROM all_findings").rows == [(1e-3,)]


def test_the_latest_version_of_a_run_counts_and_the_others_can_be_read(tmp_path) -> None:
    first, second = findings("QF-1", [1e-3]), findings("QF-1", [2e-3], version=2)
    fill(tmp_path, findings=[*first, *second], runs=with_runs([*first, *second]))
    archive = opened(str(tmp_path))
    assert archive.query("SELECT value FROM findings").rows == [(2e-3,)]
    assert archive.query("SELECT value FROM all_findings ORDER BY version").rows == [(1e-3,), (2e-3,)]
