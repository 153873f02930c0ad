"""The worked example of `docs/how-to/use_a_calibration.md`."""

import csv
import io
import json
import re

import pytest

from tests.support.runs import ROOT, read_json, run_short

pytestmark = pytest.mark.slow
PAGE = (ROOT / "docs/how-to/use_a_calibration.md").read_text("utf-8")
RECORD, RESULT = re.findall(r"```text\n(t_s.*?)```", PAGE, re.DOTALL)
RUN, COMPENSATE = re.findall(r"^    bench (run imu_24.*|compensate .*--at-start .*)$", PAGE, re.MULTILINE)


def rows(text):
    return [[float(cell) for cell in row] for row in list(csv.reader(io.StringIO(text)))[1:]]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    assert RUN == "run imu_24_position --bench config/imu.yaml --preset quick --uut a=IMU-7"
    return run_short(
        tmp_path_factory.mktemp("runs"), bench=ROOT / "config/imu.yaml", sequence="imu_24_position", preset="quick",
        settings=(), units=("a=IMU-7",),
    )  # fmt: skip


def test_the_example_gives_what_the_page_has(made, tmp_path, bench_here):
    record = tmp_path / "FLIGHT.csv"
    record.write_text(RECORD, "utf-8")
    words = COMPENSATE.replace("runs/last", str(made.path)).replace("FLIGHT.csv", str(record)).split()
    done = bench_here(*words)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0] == RESULT.splitlines()[0]
    assert rows(done.stdout) == [pytest.approx(row, rel=2e-4, abs=2e-6) for row in rows(RESULT)]
    assert "channel acc_x: from 1 to 3 g; the calibration was made from -1 to 1 g" in done.stderr


@pytest.mark.parametrize(("attitude", "signs"), [("Ax1", (1, 0, 0)), ("Ay5", (0, -1, 0)), ("Az2", (0, 0, 1))])
def test_at_rest_a_unit_counts_the_local_gravity(made, bench_here, attitude, signs):
    step = f"steps/temperature=50/attitude={attitude}/acquire"
    words = ("--to", "velocity", "--noise", "2 µg/Hz^0.5", "--step", step)
    done = bench_here("compensate", made.path / "calibration_a.json", made.path, *words)
    assert done.returncode == 0, done.stderr
    *_, last = csv.DictReader(io.StringIO(done.stdout))
    true_mps2 = read_json(made, "truth.json")["bench"]["gravity_mps2"]
    assert 15 < float(last["t_s"]) < 21
    for axis, sign in zip("xyz", signs, strict=True):
        error_mps = float(last[f"acc_{axis}_mps"]) - sign * true_mps2 * float(last["t_s"])
        # Level and heading of the table are in this run what they were in the calibration.
        assert abs(error_mps) < 4 * float(last[f"u_acc_{axis}_mps"])


def test_another_unit_and_an_unknown_step_are_refused(made, bench_here, tmp_path):
    calibration = made.path / "calibration_a.json"
    refused = bench_here("compensate", calibration, made.path, "--to", "velocity", "--step", "steps/acquire")
    assert refused.returncode == 2
    assert "there is no acquisition 'steps/acquire'" in refused.stderr
    other = {key: value for key, value in json.loads(calibration.read_text("utf-8")).items() if key != "digest"}
    (tmp_path / "other.json").write_text(json.dumps({**other, "uut": "IMU-8"}), "utf-8")
    words = ("--to", "velocity", "--step", "steps/temperature=50/attitude=Ax1/acquire")
    refused = bench_here("compensate", tmp_path / "other.json", made.path, *words)
    assert refused.returncode == 2
    assert "has no unit IMU-8, of which the calibration is, but IMU-7" in refused.stderr
