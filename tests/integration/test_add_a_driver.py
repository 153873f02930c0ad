"""The page that adds a driver, followed literally: the toy is made, installed, tested, and a sequence runs on it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys

import pytest

from bench.app.new_driver import kinds, write_driver
from tests.support.how_to import FOLDER, blocks, commands
from tests.support.runs import ROOT

pytestmark = pytest.mark.integration
PAGE = FOLDER / "add_a_driver.md"
CHAMBER = re.compile(r"^  chamber:\n(?:    .*\n)+", re.MULTILINE)


@pytest.fixture
def site(tmp_path):
    """A folder that the driver is installed in."""
    return tmp_path / "site"


@pytest.fixture
def env(site):
    return {**os.environ, "PYTHONPATH": f"{site}:{ROOT}", "PYTHONDONTWRITEBYTECODE": "1"}


def test_a_newcomer_who_follows_the_page_has_a_driver_that_runs(tmp_path, site, env):
    shutil.copytree(ROOT / "config", tmp_path / "config")
    ((_, entry),) = blocks(PAGE)
    said = {}
    for words in dict.fromkeys(map(tuple, commands(PAGE))):
        done = subprocess.run(_here(words, site), cwd=tmp_path, env=env, capture_output=True, text=True, check=False)
        said[" ".join(words[:3])] = done.stdout
        assert done.returncode == 0, (words, done.stdout, done.stderr)
        if words[0] == "cp":
            bench = tmp_path / "my_bench/simulated.yaml"
            text, count = CHAMBER.subn(entry, bench.read_text("utf-8"))
            assert count == 1
            bench.write_text(text, "utf-8")
    assert "my_chamber/my_chamber/wire.py" in said["bench new driver"]
    assert re.search(r"^chamber +my_chamber .* MAKER TC-100 0001 1.0; process_value 20", said["bench devices --bench"])
    assert "Verdict: PASS" in said["bench run smoke"]


@pytest.mark.parametrize("kind", sorted(kinds().keys() - {"thermal_chamber"}))
def test_every_other_kind_passes_its_own_tests(tmp_path, site, env, kind):
    write_driver("my_chamber", kind, tmp_path)
    for words in (("python", "-m", "pip", "install", "--no-deps", "--no-build-isolation", "my_chamber"),
                  ("python", "-m", "pytest", "-q", "my_chamber")):  # fmt: skip
        done = subprocess.run(_here(words, site), cwd=tmp_path, env=env, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


def _here(words: tuple[str, ...], site: object) -> list[str]:
    """The command with the programs of this environment; what it installs goes into a folder, from no network."""
    program, *rest = words
    if "pip" in rest:
        rest = [word for word in rest if word != "--editable"] + ["--no-index", "--quiet", "--target", str(site)]
        rest[rest.index("my_chamber")] = "./my_chamber"
    known = {"bench": [sys.executable, "-m", "bench"], "python": [sys.executable]}
    return [*known.get(program, [program]), *rest]
