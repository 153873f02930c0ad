"""A whole run on the simulated bench in virtual time, compared with the truth of the simulation, and its report."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

SEQUENCE = Path(__file__).parents[1] / "sequences" / "toy_rest.yaml"
SHORT = ("--set", "warm_up=10 min")  # while the drift is several times its uncertainty


def bench(*words, code=0):
    done = subprocess.run(
        [sys.executable, "-m", "bench", *map(str, words)], capture_output=True, text=True, check=False
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    bench("run", SEQUENCE, "--bench", "simulated", "--seed", 1, "--runs", folder, *SHORT)
    (found,) = (path.parent for path in folder.glob("*/results.json"))
    return found


def test_results_are_true_within_their_uncertainty(run):
    results = json.loads((run / "results.json").read_text("utf-8"))
    of_methods = json.loads((run / "truth.json").read_text("utf-8"))["methods"]
    truth = of_methods["toy_rest"]["rest"]["a"]
    found = {finding["quantity"]: finding for finding in results["findings"]}
    assert set(truth) < set(found)
    for quantity, true in truth.items():
        assert abs(found[quantity]["value"] - true) <= found[quantity]["expanded"], quantity
    assert 0 < found["rest_mean"]["expanded"] < 1e-5 * truth["rest_mean"]
    assert 0 < found["rest_drift"]["expanded"] < abs(truth["rest_drift"]) / 3
    assert found["rest_drift"]["verdict"] == "PASS"


@pytest.mark.parametrize(
    ("language", "texts"),
    [
        ("en", ("Readings at rest", "Output at rest, relative to its mean", "ppm/h", "over 0.16")),
        ("zh", ("静止漂移", "静止输出与漂移试验", "历时 0.16", "读数数量有限")),
    ],
)
def test_the_report_has_its_table_plot_and_words(run, language, texts):
    path = bench("report", run, "--format", "html", "--lang", language).strip()
    page = Path(path).read_text("utf-8")
    for text in texts:
        assert text in page
    assert 'id="a-0-rest-' in page


def test_too_few_readings_and_a_move_between_them_are_refused(tmp_path):
    said = bench("check", SEQUENCE, "--bench", "simulated", "--set", "readings=5", code=2)
    assert "'rest' has 5 readings; below 10, the setting fewest, no drift is stated" in said
    text = SEQUENCE.read_text("utf-8").replace(
        "      - acquire: counter\n", "      - move: head\n        to: 91°\n      - acquire: counter\n"
    )
    (tmp_path / "moving.yaml").write_text(text, "utf-8")
    assert "'head' moves between readings" in bench("check", tmp_path / "moving.yaml", "--bench", "simulated", code=2)
