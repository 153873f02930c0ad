"""The page that adds a driver, followed literally: the toy is made, installed, tested, and a sequence runs on it."""

from __future__ import annotations

import os
import re
import shutil

import pytest

from bench.app.new_package import kinds, write_driver
from tests.support.how_to import FOLDER, blocks, commands, follow
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
    outputs = {}
    for words in dict.fromkeys(map(tuple, commands(PAGE))):
        done = follow(words, tmp_path, site, env)
        outputs[" ".join(words[:3])] = done.stdout
        assert done.returncode == 0, (words, done.stdout, done.stderr)
        if words[0] == "cp":
            bench = tmp_path / "my_bench/simulated.yaml"
            text, count = CHAMBER.subn(entry, bench.read_text("utf-8"))
            assert count == 1
            bench.write_text(text, "utf-8")
    assert "my_chamber/my_chamber/wire.py" in outputs["bench new driver"]
    assert re.search(
        r"^chamber +my_chamber .* MAKER TC-100 0001 1.0; process_value 20", outputs["bench devices --bench"]
    )
    assert "Verdict: PASS" in outputs["bench run smoke"]


@pytest.mark.parametrize("kind", sorted(kinds().keys() - {"thermal_chamber"}))
def test_every_other_kind_passes_its_own_tests(tmp_path, site, env, kind):
    write_driver("my_chamber", kind, tmp_path)
    for words in (("python", "-m", "pip", "install", "my_chamber"), ("python", "-m", "pytest", "-q", "my_chamber")):
        done = follow(words, tmp_path, site, env)
        assert done.returncode == 0, done.stdout + done.stderr
