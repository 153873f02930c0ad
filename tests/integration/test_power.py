"""A run over wires whose computer loses its power: Debian's own upsd with its dummy driver at the other end."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.energised import SAFE, Process, wires
from tests.support.killed import journal
from tests.support.served import free_port

DUMMY, UPSD = Path("/lib/nut/dummy-ups"), Path("/lib/nut/upsd")  # programs of Debian, without its configuration
pytestmark = [
    pytest.mark.integration,
    pytest.mark.skipif(
        not (DUMMY.exists() and UPSD.exists()), reason="nut-server is not installed (apt install nut-server)"
    ),
]
STARTS_WITHIN_S = 20.0


class Supply:
    """upsd and a simulated supply, with a configuration of their own."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        self.port, self._state = free_port(), folder / "bench.dev"
        self.set("OL")
        (folder / "ups.conf").write_text(f"[bench]\n driver = dummy-ups\n port = {self._state}\n mode = dummy-loop\n")
        (folder / "upsd.conf").write_text(f"LISTEN 127.0.0.1 {self.port}\nMAXAGE 15\n")
        (folder / "upsd.users").write_text("")
        for name in ("ups.conf", "upsd.conf", "upsd.users"):
            (folder / name).chmod(0o640)
        places = {name: str(folder) for name in ("NUT_CONFPATH", "NUT_STATEPATH", "NUT_ALTPIDPATH", "NUT_PIDPATH")}
        settings = {
            "env": {**os.environ, **places}, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL,
        }  # fmt: skip
        self._processes = [
            subprocess.Popen([str(DUMMY), "-a", "bench", "-u", "root", "-FF"], **settings),
            subprocess.Popen([str(UPSD), "-FF", "-u", "root"], **settings),
        ]

    def set(self, status: str) -> None:
        """What the supply says from now on."""
        self._state.write_text(f"ups.status: {status}\nTIMER 1\n")

    def until(self, status: str) -> None:
        """Return when upsd says so."""
        end_s = time.monotonic() + STARTS_WITHIN_S
        while True:
            found = subprocess.run(
                ["upsc", f"bench@127.0.0.1:{self.port}", "ups.status"], capture_output=True, text=True, check=False
            )
            if found.stdout.strip() == status:
                return
            assert time.monotonic() < end_s, found
            time.sleep(0.2)

    def end(self) -> None:
        for process in self._processes:
            process.terminate()
            process.wait(10)


@pytest.fixture
def supply(tmp_path: Path) -> Iterator[Supply]:
    found = Supply(tmp_path / "nut")
    try:
        found.until("OL")
        yield found
    finally:
        found.end()


def test_a_run_is_held_on_battery_and_goes_on_when_line_power_is_back(supply, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with wires(tmp_path / "served") as bench:
        text = bench.bench.read_text("utf-8")
        power = f"power: {{ups: 'bench@127.0.0.1:{supply.port}', on_battery: hold, after: 1 h}}\n"
        bench.bench.write_text(text + power, "utf-8")
        supply.set("OB")
        supply.until("OB")
        run = Process(bench.bench, tmp_path / "run")
        run.until(lambda: "Held before step" in run.told.read_text("utf-8"))
        assert bench.supply_v() == 0
        supply.set("OL")
        run.until_step("steps/wait")
        run.process.send_signal(signal.SIGTERM)
        assert run.code() == 4
    assert run.path is not None
    kinds = [entry.kind for entry in journal(run.path) if entry.kind in ("power", "held", "released", "step_begins")]
    assert kinds[:4] == ["power", "held", "power", "released"]


def test_a_run_ends_safe_when_the_battery_is_low(supply, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with wires(tmp_path / "served") as bench:
        text = bench.bench.read_text("utf-8")
        bench.bench.write_text(f"{text}power: {{ups: 'bench@127.0.0.1:{supply.port}', after: 1 h}}\n", "utf-8")
        run = Process(bench.bench, tmp_path / "run")
        run.until_step("steps/wait")
        supply.set("OB")
        run.until(lambda: "ON BATTERY" in run.told.read_text("utf-8"))
        assert run.process.poll() is None
        supply.set("OB LB")
        assert run.code() == 4
        assert bench.state() == SAFE
    assert run.manifest()["ended_by"] == "power"
    assert run.path is not None
    states = [entry.data["state"] for entry in journal(run.path) if entry.kind == "power"]
    assert states == ["line", "battery", "low"]
