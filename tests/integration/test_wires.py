"""`bench simulate` at one end of real sockets and pseudo-terminals, `bench run` at the other, in real time."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.errors import StoreError
from bench.store.reader import RunReader
from tests.support.runs import ROOT
from tests.support.served import on_real_wires, simulating

pytestmark = pytest.mark.integration
QUICK = ("--set", "soak=2 s", "--set", "gate=2 s")


@pytest.fixture
def wired_bench(tmp_path) -> Path:
    """The demonstration bench over real wires, on free ports and in a temporary folder, its head a little faster."""
    return on_real_wires(tmp_path)


def test_a_scenario_is_played_while_instruments_are_served(wired_bench, tmp_path):
    scenario = tmp_path / "s.yaml"
    fault = "{at: 0.2 s, device: supply, fault: silent, for: 0.2 s}"
    scenario.write_text(f"schema: itb-scenario/1\ntitle: t\nfaults: [{fault}]\n", "utf-8")
    with simulating(wired_bench, "--scenario", str(scenario)) as process:
        assert process.stderr is not None
        assert [process.stderr.readline() for _ in range(2)] == ["supply silent begins\n", "supply silent ends\n"]


def run_smoke(bench: Path, runs: Path, *arguments: str) -> list[str]:
    return [
        sys.executable, "-m", "bench", "run", "smoke", "--bench", str(bench), "--runs", str(runs), "--uut", "QF-0001",
        *arguments, *QUICK,
    ]  # fmt: skip


def test_the_smoke_sequence_passes_over_real_wires(wired_bench, tmp_path):
    with simulating(wired_bench):
        done = subprocess.run(
            run_smoke(wired_bench, tmp_path / "runs"),
            capture_output=True,
            text=True,
            cwd=ROOT,
            check=False,
        )
    assert done.returncode == 0, done.stderr
    assert "Verdict: PASS" in done.stdout
    (path,) = (tmp_path / "runs").iterdir()
    with RunReader(path) as reader:
        frames = reader.frames_by_step()
        assert len(frames) == 4
        for streams in frames.values():
            assert 18 <= (streams["counter"].ids == 0x100).sum() <= 22
    assert not (tmp_path / "itb").exists() or not list((tmp_path / "itb").iterdir()), "the links are gone"


def wait_for_ramp(runs: Path) -> None:
    """Returns when a run has begun its ramp, with the supply on."""
    for _ in range(400):
        with contextlib.suppress(StoreError):
            for path in runs.glob("*"):
                with RunReader(path) as reader:
                    if any(event.step.endswith("/ramp") for event in reader.events("step_begins")):
                        return
        time.sleep(0.1)
    raise AssertionError("it does not begin its ramp")


@contextlib.contextmanager
def held_terminals(folder: Path) -> Iterator[None]:
    """Keep the pseudo-terminals of a bench: a run that has lost them owns their numbers, which others would get."""
    links = [each for each in folder.rglob("*") if each.is_symlink() and each.resolve().parent == Path("/dev/pts")]
    assert len(links) >= 2
    held = [os.open(each, os.O_RDWR | os.O_NOCTTY) for each in links]
    try:
        yield
    finally:
        for each in held:
            os.close(each)


def test_when_the_laboratory_goes_away_the_run_ends_in_words(wired_bench, tmp_path):
    with simulating(wired_bench) as laboratory:
        run = subprocess.Popen(
            run_smoke(wired_bench, tmp_path / "runs", "--set", "temperatures=[25 °C]"),
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT,
        )  # fmt: skip
        wait_for_ramp(tmp_path / "runs")
        time.sleep(1)
        with held_terminals(wired_bench.parents[1]):
            laboratory.kill()
            _, message = run.communicate(timeout=60)
    assert run.returncode == 6
    assert "chamber" in message
    assert "supply COULD NOT BE MADE SAFE: supply: no connection to" in message
    assert "Check that the instrument is on" in message


def test_another_instrument_than_the_bench_file_names_is_refused_before_anything_moves(wired_bench, tmp_path):
    other = wired_bench.with_name("other.yaml")
    text = wired_bench.read_text("utf-8")
    other.write_text(text.replace("serial: SIM-PSU-01", "serial: PSU-77").replace("SIM-6220-01", "4001234"), "utf-8")
    with simulating(wired_bench):
        done = subprocess.run(
            run_smoke(other, tmp_path / "runs"), capture_output=True, text=True, cwd=ROOT, check=False
        )
    assert done.returncode == 3
    assert "supply: serial is 'SIM-PSU-01', the bench file says 'PSU-77'" in done.stderr
    assert "source: serial is 'SIM-6220-01', the bench file says '4001234'" in done.stderr
    (path,) = (tmp_path / "runs").iterdir()
    with RunReader(path) as reader:
        assert "step_begins" not in [event.kind for event in reader.events()]


def test_real_connections_need_real_time(wired_bench, tmp_path):
    done = subprocess.run(
        run_smoke(wired_bench, tmp_path / "runs", "--speed", "max"), capture_output=True, text=True, cwd=ROOT,
        check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "--speed max: this bench has real connections, which run at speed 1 only" in done.stderr
    assert not (tmp_path / "runs").exists()


def test_nobody_at_the_other_end_names_every_instrument_that_is_missing(wired_bench, tmp_path):
    done = subprocess.run(
        run_smoke(wired_bench, tmp_path / "runs"), capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert done.returncode == 3
    for role in ("chamber", "head", "counter", "supply", "source"):
        assert f"{role}: " in done.stderr
    assert "no other program has the port" in done.stderr


def test_simulate_makes_any_bench_run_at_full_speed(wired_bench, tmp_path):
    done = subprocess.run(
        run_smoke(wired_bench, tmp_path / "runs", "--simulate"), capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert done.returncode == 0, done.stderr


def test_two_simulations_of_one_bench_are_told_apart(wired_bench):
    with simulating(wired_bench):
        second = subprocess.run(
            [sys.executable, "-m", "bench", "simulate", "--bench", str(wired_bench)], capture_output=True, text=True,
            cwd=ROOT, check=False, env={**os.environ},
        )  # fmt: skip
    assert second.returncode == 3
    assert "is another simulation running?" in second.stderr


def test_the_wired_bench_file_is_the_simulated_one_without_sim():
    simulated, wired = (
        (ROOT / "config" / name).read_text("utf-8").split("schema:", 1)[1]
        for name in ("simulated.yaml", "simulated_wires.yaml")
    )
    assert simulated.replace("sim+", "") == wired


@pytest.mark.peer("mbpoll")
def test_mbpoll_reads_the_chamber_of_a_simulated_bench(wired_bench):
    port = wired_bench.read_text("utf-8").split("unit_id")[0].rsplit("127.0.0.1:", 1)[1].split()[0]
    with simulating(wired_bench):
        shown = {}
        for what, reference in (("set point", 2783), ("process value", 2821)):
            done = subprocess.run(
                ["mbpoll", "-m", "tcp", "-p", port, "-a", "1", "-r", str(reference), "-t", "4:float", "-c", "1", "-1",
                 "127.0.0.1"], capture_output=True, text=True, check=True,
            )  # fmt: skip
            shown[what] = float(done.stdout.split(f"[{reference}]:")[1].split()[0])
    assert shown["set point"] == 20
    assert shown["process value"] == pytest.approx(20, abs=0.5)


@pytest.mark.peer("pymeasure")
@pytest.mark.parametrize("settings", [{}, {"read_termination": "\r\n", "write_termination": "\r"}])
def test_pymeasure_sets_and_reads_the_current_source_of_a_simulated_bench(wired_bench, tmp_path, settings):
    from pymeasure.adapters import VISAAdapter
    from pymeasure.instruments.keithley import Keithley6221

    with simulating(wired_bench):
        adapter = VISAAdapter(
            f"ASRL{tmp_path / 'itb' / 'source'}::INSTR", visa_library="@py", baud_rate=19200, timeout=3000, **settings
        )
        try:
            keithley = Keithley6221(adapter)
            assert "MODEL 6220,SIM-6220-01" in keithley.id
            keithley.source_range = 0.02
            keithley.source_current = 0.0012
            keithley.enable_source()
            assert keithley.source_current == pytest.approx(0.0012)
            assert keithley.source_enabled is True
            keithley.disable_source()
            assert keithley.source_enabled is False
            assert keithley.check_errors() == []
        finally:
            adapter.connection.close()
            adapter.manager.close()
