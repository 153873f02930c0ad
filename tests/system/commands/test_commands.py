"""The command line as people and scripts use it."""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bench.report.revision import verify
from bench.store.reader import RunReader
from tests.support.runs import ROOT


def test_run_prints_the_results_on_stdout_and_the_way_on_stderr(tmp_path, bench_here):
    done = bench_here("run", "smoke", "--runs", tmp_path, "--uut", "QF-7")
    assert done.returncode == 0
    assert "Smoke test: QF-7 in place a: PASS" in done.stdout
    assert "Verdict: PASS" in done.stdout
    assert "running on the shipped simulated bench" in done.stderr
    assert "times real time" in done.stderr
    assert str(next(tmp_path.iterdir()) / "report.html") in done.stderr


def test_without_a_report_a_run_is_sealed_and_verifies_and_the_report_can_be_written_later(tmp_path, bench_here):
    done = bench_here("run", "smoke", "--runs", tmp_path, "--no-report")
    (path,) = tmp_path.iterdir()
    assert (done.returncode, "\nreport " in done.stderr, (path / "report.html").exists()) == (0, False, False)
    assert bench_here("runs", "verify", path).returncode == 0
    assert json.loads((path / "manifest.json").read_text("utf-8"))["problems"] == []
    assert bench_here("report", path).returncode == 0
    assert (path / "report.html").exists()
    assert bench_here("runs", "verify", path).returncode == 0


def test_json_is_alone_on_stdout(tmp_path, bench_command):
    done = bench_command("run", "smoke", "--bench", "simulated", "--runs", tmp_path, "--no-report", "--json")
    content = json.loads(done.stdout)
    assert content["results"]["verdict"] == "PASS"
    assert content["run"] == str(next(tmp_path.iterdir()))


def test_the_bench_comes_from_the_environment_when_no_option_names_it(tmp_path, bench_here):
    environment = {"BENCH_FILE": str(ROOT / "config/simulated.yaml")}
    done = bench_here("run", "smoke", "--runs", tmp_path, "--no-report", env=environment)
    assert done.returncode == 0
    assert "running on the shipped" not in done.stderr


def test_a_failed_limit_is_exit_code_1(tmp_path, bench_here):
    sequence = tmp_path / "strict.yaml"
    sequence.write_text(
        (ROOT / "sequences/smoke.yaml").read_text("utf-8").replace("min: -5 mg, max: 5 mg", "max: 5 µg")
    )
    done = bench_here("run", sequence, "--bench", "simulated", "--runs", tmp_path / "runs", "--no-report")
    assert done.returncode == 1
    assert "Verdict: FAIL" in done.stdout
    assert "1020" in done.stdout or "10" in done.stdout
    assert " !" in done.stdout, "the value that failed is marked"


def test_runs_are_listed_oldest_first_with_state_and_verdict(smoke_run, bench_here):
    header, line = bench_here("runs", "--runs", smoke_run.path.parent).stdout.splitlines()
    assert header.split() == ["run", "state", "verdict", "units", "operator"]
    assert line.split()[:4] == [smoke_run.path.name, "completed", "PASS", "QF-0001"]


@pytest.mark.parametrize(
    ("filters", "count"),
    [(("--verdict", "pass"), 1), (("--verdict", "FAIL"), 0), (("--uut", "QF-0001", "--state", "completed"), 1),
     (("--uut", "QF-1"), 0), (("--last", "3"), 1), (("--verdict", "not-judged"), 0), (("--verdict", "Not_Judged"), 0)],
)  # fmt: skip
def test_runs_are_filtered_by_what_they_came_to(smoke_run, bench_here, filters, count):
    assert len(json.loads(bench_here("runs", "--runs", smoke_run.path.parent, *filters, "--json").stdout)) == count


@pytest.mark.parametrize(
    ("filters", "reported"),
    [
        (
            ("--verdict", "PASSED"),
            "PASSED: unknown, expected PASS, FAIL, ERROR, ABORTED, INCOMPLETE, NOT JUDGED; did you",
        ),
        (
            ("--state", "over"),
            "over: unknown, expected running, completed, failed, error, aborted, interrupted, damaged",
        ),
    ],
)
def test_a_filter_that_no_run_can_meet_is_refused(smoke_run, bench_here, filters, reported):
    done = bench_here("runs", "--runs", smoke_run.path.parent, *filters)
    assert (done.returncode, done.stdout) == (2, "")
    assert reported in done.stderr


def test_a_file_that_is_no_case_is_no_run_either(tmp_path, bench_here):
    with (tmp_path / "big.csv").open("wb") as file:
        file.truncate(2**40)
    done = bench_here("reduce", tmp_path / "big.csv")
    assert done.returncode == 2
    assert "big.csv: is neither a case nor a run" in done.stderr


def test_the_status_of_a_run_is_text_for_people_and_json_for_programs(smoke_run, bench_here):
    reported = bench_here("status", smoke_run.path).stdout
    assert reported.startswith(f"{smoke_run.path.name}: completed, PASS\n")
    assert "steps done  13" in reported
    assert json.loads(bench_here("status", smoke_run.path, "--json").stdout)["done"] == 13


def test_the_program_names_its_version(bench_here):
    assert bench_here("--version").stdout.startswith("inertial-test-bench 0.")


def test_a_run_verifies_until_somebody_touches_it(smoke_run, tmp_path, bench_here):
    import shutil

    copy = tmp_path / smoke_run.path.name
    shutil.copytree(smoke_run.path, copy)
    assert bench_here("runs", "verify", copy).returncode == 0
    with (copy / "bench.yaml").open("a") as file:
        file.write("# touched\n")
    done = bench_here("runs", "verify", copy)
    assert done.returncode == 3
    assert "bench.yaml: has changed since it was written" in done.stdout


def test_plan_lists_every_step_with_its_time(bench_here):
    done = bench_here("plan", "tumble_static", "--bench", "simulated")
    lines = done.stdout.splitlines()
    assert done.returncode == 0
    listed = lines[: lines.index("")]
    assert len(listed) == 421 + 1
    assert "setup/then/wait" in listed[3]
    assert lines[-1].startswith("421 steps, about 32 h 5")
    assert lines[-1].endswith("MB")


def test_the_estimate_of_the_plan_is_close_to_the_run(smoke_run, bench_here):
    """A minute of bench time; the long sequences are judged by the same arithmetic."""
    done = bench_here("plan", "smoke", "--bench", "simulated")
    estimated_s = float(done.stdout.splitlines()[-1].split("about ")[1].split(" s")[0])
    assert estimated_s == pytest.approx(smoke_run.bench_s, rel=0.05)


def test_devices_are_identified_and_read(bench_here):
    done = bench_here("devices", "--bench", "simulated")
    assert done.returncode == 0
    lines = dict(line.split(maxsplit=1) for line in done.stdout.splitlines())
    assert set(lines) == {"chamber", "head", "counter", "supply", "source"}
    assert "serial stated, not verified" in lines["chamber"]
    assert "KEITHLEY INSTRUMENTS INC. MODEL 6220 SIM-6220-01" in lines["source"]
    assert "not verified" not in lines["source"]


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_a_csv_export_holds_the_readings_and_the_raw_counts(smoke_run, tmp_path, bench_here):
    done = bench_here("export", smoke_run.path, "--format", "csv", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    readings = rows_of(tmp_path / "readings.csv")
    with RunReader(smoke_run.path) as reader:
        unit = reader.series("unit_temperature")
    exported = [float(row["value"]) for row in readings if row["name"] == "unit_temperature"]
    np.testing.assert_array_equal(exported, unit.values)
    counts = rows_of(tmp_path / "acquisitions.csv")
    assert {row["channel"] for row in counts} == {"x", "y", "z"}
    assert len({row["step"] for row in counts}) == 4


def test_a_candump_export_is_decoded_by_cantools_with_our_dbc(smoke_run, tmp_path, bench_here):
    done = bench_here("export", smoke_run.path, "--format", "candump", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    log = (tmp_path / "counter.log").read_text("ascii")
    assert log.startswith("(17672256")  # 2026-01-01, where simulated runs begin
    decoded = subprocess.run(
        [sys.executable, "-m", "cantools", "decode", "--single-line", smoke_run.path / "if_counter.dbc"],
        input=log, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    lines = decoded.splitlines()
    assert len(lines) == len(log.splitlines())
    latches = [line for line in lines if "Latch(" in line]
    with RunReader(smoke_run.path) as reader:
        expected = sum((streams["counter"].ids == 0x100).sum() for streams in reader.frames_by_step().values())
    assert len(latches) == expected
    assert "Tick:" in latches[0]
    assert "Unknown" not in decoded


def test_a_case_is_reduced_to_result_json(tmp_path, bench_here):
    rows = ["T_C,U_V"] + [f"{t},{0.1 + 1e-5 * t}" for t in range(-40, 61, 10)]
    (tmp_path / "tilt.csv").write_text("\n".join(rows) + "\n")
    case = {
        "schema": "itb-case/1", "method": "M4", "sub": "tilt", "site": {"lat_deg": 34.25, "h_m": 420},
        "settings": {"K1_V_per_g": 1.13, "B0_V": 0.0, "B1_V_per_C": 1e-5, "K0_nominal_V": 0.0},
        "records": {"tilt": "tilt.csv"},
    }  # fmt: skip
    (tmp_path / "case.json").write_text(json.dumps(case))
    done = bench_here("reduce", tmp_path / "case.json", "--out", tmp_path / "out" / "deep")
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "out" / "deep" / "result.json").read_text("utf-8"))
    assert result["comp_span_deg"] == pytest.approx(0, abs=1e-9)
    assert result["raw_span_deg"] == pytest.approx(0.0509, rel=0.01)
    assert json.loads(bench_here("reduce", tmp_path / "case.json", "--json").stdout) == result
    missing = bench_here("reduce", tmp_path / "nothing.json", "--out", tmp_path)
    assert missing.returncode == 2


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("run", "smoke", "--bench", "nowhere.yaml"), "nowhere.yaml: there is no such file"),
        (("run", "smok"), "smok: there is no such sequence; did you mean 'smoke'?"),
        (("run", "smoke", "--speed", "fast"), "--speed fast: expected max, or a number above 0"),
        (("run", "smoke", "--speed", "-1"), "--speed -1: expected max, or a number above 0"),
        (("run", "smoke", "--speed", "nan"), "--speed nan: expected max"),
        (("run", "smoke", "--uut", "b=X"), "the bench has no place 'b'"),
        (("run", "smoke", "--uut", "a="), "expected a serial number"),
        (("run", "smoke", "--preset", "quick"), "there is no preset 'quick'"),
        (("export", "last", "--format", "xls"), "--format xls: unknown"),
        (("report", "no-such-run"), "there is no run 'no-such-run'"),
        (("check", "tumble_static", "--set", "gat=5 s"), "there is no parameter 'gat'; did you mean 'gate'?"),
    ],
)
def test_what_cannot_be_done_is_told_with_exit_code_2(tmp_path, bench_here, arguments, expected):
    done = bench_here(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert expected in done.stderr
    assert "Traceback" not in done.stderr


def test_the_digest_of_a_damaged_run_is_refused_or_marked(smoke_run, tmp_path, bench_here):
    folder = shutil.copytree(smoke_run.path, tmp_path / smoke_run.path.name)
    text = (folder / "results.json").read_text("utf-8")
    (folder / "results.json").write_text(text.replace("PASS", "FAIL"), "utf-8")
    refused = bench_here("runs", "digest", folder)
    assert (refused.returncode, refused.stdout) == (3, "")
    assert "--damaged" in refused.stderr
    marked = bench_here("runs", "digest", folder, "--damaged")
    assert (marked.returncode, len(marked.stdout.strip())) == (0, 64)
    assert "damaged" in marked.stderr


@pytest.mark.parametrize(
    ("make", "reported"),
    [
        (os.mkfifo, "is not a regular file; remove it, then"),
        (Path.mkdir, "is a folder; remove it, then"),
        (lambda path: path.symlink_to("/dev/zero"), "is not a regular file; remove it, then"),
        (lambda path: None, "there is no such file; but"),
        (lambda path: path.write_text("PASS", "utf-8"), "has changed since it was written;"),
    ],
)
def test_what_is_in_the_place_of_a_report_is_said(smoke_run, tmp_path, make, reported):
    folder = shutil.copytree(smoke_run.path, tmp_path / smoke_run.path.name)
    (folder / "report.html").unlink()
    make(folder / "report.html")
    (problem,) = verify(folder)
    assert problem == f"{folder / 'report.html'}: {reported} 'bench report {folder.name}' writes it again"
