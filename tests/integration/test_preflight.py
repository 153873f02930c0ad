"""A bench over wires that is looked at before it is left alone; a client that is no part of the program reads it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.clock import wall_utc
from bench.config.bench import load_bench
from bench.runner.held import energising_addresses
from bench.store.energised import note_energised
from tests.support.energised import Wires, wires
from tests.support.killed import journal
from tests.support.runs import ROOT

pytestmark = pytest.mark.integration
# The thermometer is read once a second; on a busy machine a gate of 1 s may lie between two readings.
QUICK = ("--set", "temperatures=[20 °C]", "--set", "soak=2 s", "--set", "gate=1.5 s", "--uut", "QF-0001")
PLANNED = QUICK[:-2]


@pytest.fixture(scope="module")
def served(tmp_path_factory) -> Iterator[Wires]:
    with wires(tmp_path_factory.mktemp("served")) as bench:
        yield bench


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def alerting(bench: Wires, folder: Path) -> Path:
    """The bench file with an alert that writes into the folder."""
    path = bench.edited(folder, "none", lambda line: line)
    program = f'(cat; echo "$0") >> {folder / "alerts"}'
    path.write_text(path.read_text("utf-8") + f"alert: {{exec: [/bin/sh, -c, '{program}']}}\n", "utf-8")
    return path


def bench_command(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "bench", *words], capture_output=True, text=True, cwd=ROOT, check=False,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip


def states(done: subprocess.CompletedProcess[str]) -> dict[str, tuple[str, str]]:
    return {line["what"]: (line["state"], line["text"]) for line in json.loads(done.stdout)["lines"]}


def test_a_bench_that_is_ready_is_left_alone_and_tells_how_it_ended(served, tmp_path):
    bench = str(alerting(served, tmp_path))
    assert bench_command("alert", "--bench", bench).returncode == 0
    rehearsed = bench_command("rehearse", "smoke", "--bench", bench, "--runs", str(tmp_path / "rehearsed"), *PLANNED)
    assert rehearsed.returncode == 0, rehearsed.stderr
    before = served.state()
    looked_at = bench_command("preflight", "smoke", "--bench", bench, *QUICK)
    assert looked_at.returncode == 0, looked_at.stdout
    assert "READY TO BE LEFT ALONE" in looked_at.stdout
    assert served.state() == before
    runs = tmp_path / "runs"
    done = bench_command("run", "smoke", "--bench", bench, "--runs", str(runs), "--unattended", *QUICK)
    assert done.returncode == 0, done.stderr
    (path,) = runs.iterdir()
    (entry,) = (entry for entry in journal(path) if entry.kind == "preflight")
    assert {line["state"] for line in entry.data["lines"]} == {"ok", "look"}
    assert f"{path.name}: PASS" in (tmp_path / "alerts").read_text("utf-8")


def test_a_bench_that_is_not_ready_is_not_energised(served, tmp_path):
    bench = tmp_path / "config" / served.bench.name
    served.edited(tmp_path, "supply", lambda line: line.replace("SIM-PSU-01", "PSU-77"))
    loaded = load_bench(bench)
    addresses = {role: str(address) for role, address in energising_addresses(loaded.bench).items()}
    note_energised(tmp_path / "runs" / "earlier", bench, wall_utc(), {"chamber": addresses["chamber"]})
    before = served.state()
    found = states(bench_command("preflight", "smoke", "--bench", str(bench), "--json", *QUICK))
    assert {what for what, (verdict, _) in found.items() if verdict == "NO"} == {
        "instruments", "left on", "rehearsal", "alert",
    }  # fmt: skip
    assert "supply: serial is 'SIM-PSU-01', the bench file says 'PSU-77'" in found["instruments"][1]
    assert "chamber (earlier): bench make-safe --bench" in found["left on"][1]
    runs = tmp_path / "runs"
    done = bench_command("run", "smoke", "--bench", str(bench), "--runs", str(runs), "--unattended", *QUICK)
    assert done.returncode == 2
    assert "NOT READY: instruments, left on, rehearsal, alert" in done.stderr
    assert not runs.exists()
    assert served.state() == before


def test_what_the_instruments_themselves_say_is_shown_and_left_as_it_is(served, tmp_path):
    try:
        served.energise()
        before = served.state()
        found = states(bench_command("preflight", "smoke", "--bench", str(served.bench), "--json", *QUICK))["left on"]
        assert found[0] == "NO"
        for words in ("chamber: set point 60 °C, air", "source: output on, 0.005 A", "supply: output on, 15 V"):
            assert words in found[1]
        assert served.state() == before
        served.make_safe("supply")
        served.make_safe("source")
        found = states(bench_command("preflight", "smoke", "--bench", str(served.bench), "--json", *QUICK))["left on"]
        assert (found[0], "supply" in found[1]) == ("look", False)
    finally:
        for role in served.state():
            served.make_safe(role)


def test_an_absent_bench_is_named_instrument_by_instrument(tmp_path):
    found = states(bench_command("preflight", "smoke", "--bench", "config/simulated_wires.yaml", "--json", *QUICK))
    assert found["instruments"][0] == "NO"
    for role in ("chamber", "head", "counter", "supply", "source"):
        assert f"{role}: " in found["instruments"][1]
