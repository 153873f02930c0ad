"""The page that adds a method, followed literally: it is made, built, installed and tested, and a sequence has it."""

from __future__ import annotations

import json
import os
import re

import pytest

from tests.support.how_to import FOLDER, commands, follow
from tests.support.runs import ROOT

pytestmark = pytest.mark.integration
PAGE = FOLDER / "add_a_method.md"


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    """The folder in which every command of the page was run, and what each said."""
    folder, site = tmp_path_factory.mktemp("method"), tmp_path_factory.mktemp("site")
    env = {**os.environ, "PYTHONPATH": f"{site}:{ROOT}", "PYTHONDONTWRITEBYTECODE": "1"}
    outputs = {}
    for words in dict.fromkeys(map(tuple, commands(PAGE))):
        done = follow(words, folder, site, env)
        assert done.returncode == 0, (words, done.stdout, done.stderr)
        outputs[" ".join(words[:3])] = done.stdout
    return folder, site, outputs


@pytest.fixture(scope="module")
def run(followed):
    (found,) = (followed[0] / "runs").iterdir()
    return found


def test_what_runs_is_the_wheel(followed):
    _, site, outputs = followed
    assert (site / "my_drift/method.py").is_file()
    assert "my_drift = my_drift.method:DESCRIPTION" in next(site.glob("*.dist-info/entry_points.txt")).read_text()
    assert "Verdict: PASS" in outputs["bench run my_drift/sequences/my_drift.yaml"]
    assert re.search(
        r"rest drift +-?[\d.]+ ± [\d.]+ +ppm/h +PASS", outputs["bench run my_drift/sequences/my_drift.yaml"]
    )


def test_its_results_are_true_within_their_uncertainty(run):
    results = json.loads((run / "results.json").read_text("utf-8"))
    truth = json.loads((run / "truth.json").read_text("utf-8"))["methods"]["my_drift"]["rest"]["a"]
    found = {finding["quantity"]: finding for finding in results["findings"]}
    assert found.keys() == {"rest_mean", "rest_drift", "rest_scatter"}
    for quantity, true in truth.items():
        assert abs(found[quantity]["value"] - true) <= found[quantity]["expanded"]


def test_its_table_plot_and_words_are_in_the_report_in_chinese(followed, run):
    page = (followed[0] / followed[2]["bench report last"].strip()).read_text("utf-8")
    for text in ("静止输出与漂移试验", "静止漂移", "静止读数分散", "历时 0.16", "读数数量有限", "ppm/h"):
        assert text in page, text
    assert 'id="a-0-rest-' in page
    english = (run / "report.html").read_text("utf-8")
    for text in ("Readings at rest", "Output at rest, relative to its mean", "few readings", "over 0.16"):
        assert text in english, text
    rows = re.findall(r'<th scope="row">(\d+)</th><td[^>]*>[\d.]+</td><td[^>]*>113\d\d\.', english)
    assert rows == [str(number) for number in range(1, 61)]
