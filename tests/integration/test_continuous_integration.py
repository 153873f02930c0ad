"""The recipes of continuous_integration.md, run as written in a repository of their own with the installed wheel."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.support.how_to import FOLDER, blocks, commands
from tests.support.junit import cases
from tests.support.runs import ROOT

pytestmark = [pytest.mark.integration, pytest.mark.slow]
PAGE = FOLDER / "continuous_integration.md"
GITHUB, GITLAB = (yaml.safe_load(text) for _, text in blocks(PAGE))
SEQUENCE = Path("sequences/warm_up.yaml")


@pytest.fixture(scope="module")
def env(tmp_path_factory) -> dict[str, str]:
    """An environment in which pip installs the wheel of this checkout, from no network, into a folder of its own."""
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder, ROOT],
        check=True, capture_output=True,
    )  # fmt: skip
    site = folder / "site"
    return {
        **os.environ, "PIP_NO_INDEX": "1", "PIP_NO_DEPS": "1", "PIP_FIND_LINKS": str(folder), "PIP_TARGET": str(site),
        "PIP_UPGRADE": "1", "PYTHONPATH": str(site), "BENCH_FILE": "",
        "PATH": os.pathsep.join([str(site / "bin"), str(Path(sys.executable).parent), os.environ["PATH"]]),
    }  # fmt: skip


@pytest.fixture
def repository(tmp_path, env) -> Path:
    """The repository that the first commands of the page write."""
    assert installed(tmp_path, env) == [0]
    for words in commands(PAGE):
        subprocess.run(words, cwd=tmp_path, env=env, check=True, capture_output=True)
    return tmp_path


def ran(lines: Sequence[str], folder: Path, env: Mapping[str, str]) -> list[subprocess.CompletedProcess[str]]:
    """The lines, each run as both services do."""
    shell = ["bash", "-e", "-o", "pipefail", "-c"]
    return [
        subprocess.run([*shell, line], cwd=folder, env=env, capture_output=True, text=True, check=False)
        for line in lines
    ]


def installed(folder: Path, env: Mapping[str, str]) -> list[int]:
    """The exit codes of the lines that install; both recipes have the same ones."""
    (line,) = GITLAB["default"]["before_script"]
    assert all(lines_of(job)[0] == line for job in GITHUB["jobs"].values())
    return [done.returncode for done in ran([line], folder, env)]


def lines_of(job: Mapping[str, Any]) -> list[str]:
    return [step["run"] for step in job["steps"] if "run" in step]


def spoiled(repository: Path) -> None:
    path = repository / SEQUENCE
    text = path.read_text("utf-8")
    assert "move: head" in text
    path.write_text(text.replace("move: head", "mvoe: head", 1), "utf-8")


def test_the_check_of_github_passes_and_then_shows_an_error_at_its_line(repository, env):
    assert "/site/bench/" in ran(["python -c 'import bench; print(bench.__file__)'"], repository, env)[0].stdout
    _, *lines = lines_of(GITHUB["jobs"]["check"])
    assert [(done.returncode, done.stdout) for done in ran(lines, repository, env)] == [(0, ""), (0, "")]
    sarif = repository / GITHUB["jobs"]["check"]["steps"][-1]["with"]["sarif_file"]
    assert json.loads(sarif.read_text("utf-8"))["runs"][0]["results"] == []
    spoiled(repository)
    annotated, written = ran(lines, repository, env)
    assert (annotated.returncode, written.returncode) == (2, 2)
    assert annotated.stdout.startswith(f"::error file={SEQUENCE},line=")
    (result, *_) = json.loads(sarif.read_text("utf-8"))["runs"][0]["results"]
    place = result["locations"][0]["physicalLocation"]
    assert place["artifactLocation"]["uri"] == str(SEQUENCE)
    assert f"line={place['region']['startLine']}," in annotated.stdout


def test_the_check_of_gitlab_has_a_case_for_each_file_and_problems_in_the_log(repository, env):
    report = repository / GITLAB["check"]["artifacts"]["reports"]["junit"]
    (passed,) = ran(GITLAB["check"]["script"], repository, env)
    assert (passed.returncode, passed.stderr) == (0, "")
    found = cases(report.read_text("ascii"))
    assert {str(SEQUENCE), "config/lab.yaml", "config/uut/quartz_flexure.yaml"} <= set(found)
    assert all(len(case) == 0 for case in found.values())
    spoiled(repository)
    (failed,) = ran(GITLAB["check"]["script"], repository, env)
    assert failed.returncode == 2
    (failure,) = cases(report.read_text("ascii"))[str(SEQUENCE)]
    assert failure.tag == "failure"
    assert failure.text.splitlines()[0] in failed.stderr


def test_both_rehearse_a_night_and_keep_its_verdicts_and_reports(repository, env):
    job = GITLAB["rehearse"]
    assert job["script"] == lines_of(GITHUB["jobs"]["rehearse"])[1:]
    (done,) = ran(job["script"], repository, env)
    assert (done.returncode, done.stderr) == (0, "")
    kept = GITHUB["jobs"]["rehearse"]["steps"][-1]["with"]["path"].splitlines()
    assert kept == [job["artifacts"]["reports"]["junit"], *job["artifacts"]["paths"]]
    (case,) = cases((repository / kept[0]).read_text("ascii")).values()
    assert case.attrib["name"] == f"{SEQUENCE} on config/lab.yaml"
    assert [child.tag for child in case] == ["system-out"]
    (report,) = repository.glob(kept[1])
    assert str(report.relative_to(repository)) in case[0].text
