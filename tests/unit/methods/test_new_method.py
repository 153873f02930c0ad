"""A method to start from: what is written, under which name, and what is refused."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from bench.app.new_package import write_method
from bench.errors import InputError

LINES = {"method.py": 60, "reduction.py": 130, "rules.py": 70, "shown.py": 80, "offline.py": 80, "truth.py": 50}


def test_the_toy_becomes_the_name_everywhere(tmp_path, bench_here):
    done = bench_here("new", "method", "my_big_test", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    written = [path for path in (tmp_path / "my_big_test").rglob("*") if path.is_file()]
    assert sorted(done.stdout.splitlines()) == sorted(map(str, written))
    texts = {path.name: path.read_text("utf-8") for path in written}
    assert not [name for name, text in texts.items() if re.search("toy", text, re.IGNORECASE)]
    assert "class MyBigTestSettings(StrictModel):" in texts["method.py"]
    assert 'name = "my-big-test"' in texts["pyproject.toml"]
    assert 'my_big_test = "my_big_test.method:DESCRIPTION"' in texts["pyproject.toml"]
    assert "  - method: my_big_test\n" in texts["my_big_test.yaml"]
    assert "reduction" not in re.sub(r'""".*?"""', "", texts["truth.py"], flags=re.DOTALL)
    assert all(texts[name].count("\n") <= most for name, most in LINES.items())


@pytest.mark.parametrize("name", ["a_test", "zz", "a_long_name_of_a_test_of_a_unit"])
def test_what_is_written_is_of_our_standard_under_any_name(tmp_path, name):
    write_method(name, tmp_path)
    for check in (["check"], ["format", "--check"]):
        done = subprocess.run(
            [sys.executable, "-m", "ruff", *check, "--no-cache", "."], cwd=tmp_path / name, capture_output=True,
            text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    ("name", "reported"),
    [
        ("My-Test", "NAME: is 'My-Test', expected a name"),
        ("threshold", "NAME: there is a method 'threshold' already; choose another name"),
        ("json", "NAME: there is a Python module 'json' already; choose another name"),
        ("there", "there: is there already; choose another name, or remove it first"),
    ],
)
def test_what_cannot_be_written_is_told_in_words(tmp_path, name, reported):
    (tmp_path / "there").mkdir()
    with pytest.raises(InputError) as caught:
        write_method(name, tmp_path)
    assert reported in str(caught.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["there"]
