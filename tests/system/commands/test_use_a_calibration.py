"""The worked example of `docs/how-to/use_a_calibration.md`."""

import csv
import io
import re

import pytest

from tests.support.runs import ROOT, run_short

pytestmark = pytest.mark.slow
PAGE = (ROOT / "docs/how-to/use_a_calibration.md").read_text("utf-8")
RECORD, RESULT = re.findall(r"```csv\n(.*?)```", PAGE, re.DOTALL)
RUN, COMPENSATE = re.findall(r"^    bench (run imu_24.*|compensate .*--to .*)$", PAGE, re.MULTILINE)


def rows(text):
    return [[float(cell) for cell in row] for row in list(csv.reader(io.StringIO(text)))[1:]]


def test_the_example_gives_what_the_page_has(tmp_path, bench_here):
    assert RUN == "run imu_24_position --bench config/imu.yaml --preset quick --uut a=IMU-7"
    made = run_short(
        tmp_path / "runs", bench=ROOT / "config/imu.yaml", sequence="imu_24_position", preset="quick",
        settings=(), units=("a=IMU-7",),
    )  # fmt: skip
    record = tmp_path / "FLIGHT.csv"
    record.write_text(RECORD, "utf-8")
    words = COMPENSATE.replace("runs/last", str(made.path)).replace("FLIGHT.csv", str(record)).split()
    done = bench_here(*words)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0] == RESULT.splitlines()[0]
    assert rows(done.stdout) == [pytest.approx(row, rel=2e-4, abs=2e-6) for row in rows(RESULT)]
    assert "channel acc_x: from 1 to 3 g; the calibration was made from -1 to 1 g" in done.stderr
