"""A driver to start from: what is written, under which name, and what is refused."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from bench.app.new_package import kinds, write_driver
from bench.errors import InputError
from drivers.capabilities import THERMOMETER
from tests.support.capabilities import CAPABILITIES
from tests.support.runs import ROOT

LINES = {"wire.py": 120, "driver.py": 150, "simulator.py": 120}


def test_the_toy_becomes_the_name_everywhere(tmp_path, bench_here):
    done = bench_here("new", "driver", "my_big_oven", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    written = [path for path in (tmp_path / "my_big_oven").rglob("*") if path.is_file()]
    assert sorted(done.stdout.splitlines()) == sorted(map(str, written))
    texts = {path.name: path.read_text("utf-8") for path in written}
    assert not [name for name, text in texts.items() if re.search("toy", text, re.IGNORECASE)]
    assert "class MyBigOven(Chamber):" in texts["driver.py"]
    assert 'name = "my-big-oven"' in texts["pyproject.toml"]
    assert 'my_big_oven = "my_big_oven.description:DESCRIPTION"' in texts["pyproject.toml"]
    assert all(texts[name].count("\n") <= most for name, most in LINES.items())


@pytest.mark.parametrize("kind", kinds())
@pytest.mark.parametrize("name", ["an_oven", "zz"])
def test_what_is_written_is_of_our_standard_under_any_name(tmp_path, name, kind):
    write_driver(name, kind, tmp_path)
    for check in (["check"], ["format", "--check"]):
        done = subprocess.run(
            [sys.executable, "-m", "ruff", *check, "--no-cache", "."], cwd=tmp_path / name, capture_output=True,
            text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout


def test_there_is_a_template_for_each_kind_and_it_is_a_capability():
    assert set(kinds()) == {path.name for path in (ROOT / "templates/driver").iterdir()}
    assert set(kinds()) <= {*CAPABILITIES, THERMOMETER}


@pytest.mark.parametrize(
    ("name", "kind", "reported"),
    [
        ("My-Oven", "thermal_chamber", "NAME: is 'My-Oven', expected a name"),
        ("watlow_f4", "thermal_chamber", "NAME: there is a driver 'watlow_f4' already; choose another name"),
        ("json", "thermal_chamber", "NAME: there is a Python module 'json' already; choose another name"),
        ("simulators", "thermal_chamber", "NAME: there is a Python module 'simulators' already"),
        ("my_oven", "chamber", "--kind chamber: there is no template of this kind"),
        ("there", "thermal_chamber", "there: is there already; choose another name, or remove it first"),
    ],
)
def test_what_cannot_be_written_is_told_in_words(tmp_path, name, kind, reported):
    (tmp_path / "there").mkdir()
    with pytest.raises(InputError) as caught:
        write_driver(name, kind, tmp_path)
    assert reported in str(caught.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["there"]
