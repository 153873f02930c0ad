"""The command with standard streams that are closed or in a narrow encoding, and with modules that end programs."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from bench.cli import exits
from tests.support.runs import ROOT

SMOKE = ("run", "smoke", "--bench", "simulated", "--no-report")


def done(closed, *arguments, **env):
    """The exit code of the command with these streams closed, and what it wrote to the others."""
    words = f'exec "$@" {" ".join(f"{number}>&-" for number in closed)}'
    return subprocess.run(
        ["sh", "-c", words, "sh", sys.executable, "-m", "bench", *map(str, arguments)], capture_output=True, timeout=50,
        cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT), **env}, check=False,
    )  # fmt: skip


@pytest.mark.parametrize("closed", [(1,), (2,), (0, 1, 2)], ids=str)
def test_a_run_goes_through_without_standard_streams(tmp_path, closed, bench_command):
    assert done(closed, *SMOKE, "--runs", tmp_path).returncode == exits.PASS
    assert "sealed" in bench_command("runs", "verify", "last", "--runs", tmp_path).stdout


def test_other_commands_do_without_them_too(tmp_path):
    assert done((1, 2), "runs", "--runs", tmp_path).returncode == 0
    assert done((1, 2), "check", tmp_path / "none.yaml").returncode == exits.INPUT_ERROR


def test_what_an_encoding_does_not_have_is_escaped(tmp_path):
    narrow = {"PYTHONIOENCODING": "ascii"}
    assert done((), *SMOKE, "--runs", tmp_path, "--uut", "加速-1", "--operator", "\U0001f600", **narrow).returncode == 0
    listed = done((), "runs", "--runs", tmp_path, **narrow)
    assert (listed.returncode, b"\\u52a0\\u901f-1" in listed.stdout) == (0, True)
    assert "加速-1" in str(json.loads(done((), "runs", "--runs", tmp_path, "--json", **narrow).stdout))
    assert done((), "plan", "smoke", "--bench", "simulated", **narrow).returncode == 0


@pytest.mark.parametrize("module", ["pydantic", "cantools", "json"])
def test_a_module_that_ends_the_program_is_an_error(tmp_path, module):
    """Not a PASS, whatever its exit code; json is imported before the command line is read."""
    (tmp_path / f"{module}.py").write_text("raise SystemExit(0)\n", "utf-8")
    ended = done((), *SMOKE, "--runs", tmp_path / "runs", PYTHONPATH=f"{tmp_path}{os.pathsep}{ROOT}")
    assert ended.returncode == exits.BENCH_ERROR
    assert b"SystemExit" in ended.stderr


def test_ctrl_c_before_a_run_is_never_lost(tmp_path):
    """It comes within a `__del__`, from which Python raises nothing."""
    (tmp_path / "sitecustomize.py").write_text(
        "import os, signal, sys\n"
        "class Dying:\n"
        "    def __del__(self):\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "def seen(event, of):\n"
        "    if event == 'import' and of[0] == 'pydantic':\n"
        "        Dying()\n"
        "sys.addaudithook(seen)\n",
        "utf-8",
    )
    ended = done((), *SMOKE, "--runs", tmp_path / "runs", PYTHONPATH=f"{tmp_path}{os.pathsep}{ROOT}")
    assert (ended.returncode, ended.stderr) == (exits.ABORTED, b"interrupted\n")
    assert not (tmp_path / "runs").exists()
