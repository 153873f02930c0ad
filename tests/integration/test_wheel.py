"""The sdist and the wheel built from it are complete: installed in an empty folder, away from the source tree."""

from __future__ import annotations

import os
import subprocess
import sys
import tarfile
import zipfile

import pytest

from tests.support.runs import ROOT

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A folder with the sdist, and with the wheel that was built from it."""
    folder = tmp_path_factory.mktemp("dist")
    subprocess.run(
        [sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT], check=True, capture_output=True
    )
    return folder


@pytest.fixture(scope="module")
def wheel(built):
    (path,) = built.glob("*.whl")
    return path


def test_the_sdist_holds_what_is_versioned_and_nothing_that_was_built(built):
    (path,) = built.glob("*.tar.gz")
    with tarfile.open(path) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    versioned = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    assert set(versioned) - names == set()
    assert names - set(versioned) == {"PKG-INFO"}


def test_the_release_has_a_section_of_the_changelog(wheel):
    version = wheel.name.split("-")[1]
    assert f"\n## {version} - 20" in (ROOT / "CHANGELOG.md").read_text("utf-8")


def test_the_wheel_runs_the_smoke_sequence_in_an_empty_folder(wheel, tmp_path):
    installed, empty = tmp_path / "installed", tmp_path / "empty"
    empty.mkdir()
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", installed, wheel],
        check=True, capture_output=True,
    )  # fmt: skip
    env = {**os.environ, "PYTHONPATH": str(installed), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "bench", "run", "smoke"], capture_output=True, text=True, cwd=empty, env=env, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "Verdict: PASS" in done.stdout
    (run,) = (empty / "runs").iterdir()
    assert (run / "report.html").stat().st_size > 10_000
    checked = subprocess.run(
        [sys.executable, "-m", "bench", "check", "tumble_static"],
        capture_output=True,
        text=True,
        cwd=empty,
        env=env,
        check=True,
    )
    assert str(installed / "bench" / "shipped" / "sequences" / "tumble_static.yaml") in checked.stdout
    for command in (["new", "bench", "mine"], ["check", "smoke", "--bench", "mine.yaml"]):
        done = subprocess.run(
            [sys.executable, "-m", "bench", *command], capture_output=True, text=True, cwd=empty, env=env, check=False
        )
        assert done.returncode == 0, done.stderr
    copied = {path.name for path in (empty / "config").iterdir()}
    assert {"bench.schema.json", "if_counter.dbc", "mine.yaml"} < copied


def test_the_wheel_holds_the_packages_their_data_and_no_tests(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.split("/")[0] for name in names}
    assert tops - {"bench", "drivers", "simulators"} == {next(top for top in tops if top.endswith(".dist-info"))}
    assert "bench/shipped/config/uut/quartz_flexure.yaml" in names
    assert "bench/shipped/config/if_counter.dbc" in names
    assert "bench/shipped/docs/schema/sequence.schema.json" in names
    assert "bench/shipped/docs/schema/scenario.schema.json" in names
    assert "bench/shipped/config/scenarios/bad_night.yaml" in names
    assert "bench/shipped/templates/driver/thermal_chamber/toy_chamber/wire.py" in names
    assert "bench/shipped/templates/method/toy_rest/method.py" in names
    assert "bench/sequence/document/starter.yaml" in names
    assert any(name.endswith("report.html.j2") for name in names)
    assert {"bench/web/templates/base.html.j2", "bench/web/static/style.css", "bench/web/assets.toml"} <= set(names)
    vendor = {name.removeprefix("bench/web/static/vendor/") for name in names if "/vendor/" in name}
    assert {
        "htmx.min.js",
        "uplot.min.js",
        "sse.min.js",
        "uplot.LICENSE",
        "codemirror.min.js",
        "codemirror-view.LICENSE",
    } <= vendor
    assert not any("axe" in name or "esbuild" in name for name in vendor)  # of the tests and of the build
    assert "bench/py.typed" in names
