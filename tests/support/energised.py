"""The demonstration bench on real wires, energised and read by a client that is no part of the program."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import serial

from bench.config.bench import load_bench
from bench.runner.held import LOOKS, energising_addresses, owners
from bench.store.reader import RunReader
from tests.support.runs import ROOT
from tests.support.served import on_real_wires, simulating

SEQUENCE = """\
schema: itb-sequence/1
title: Energised
needs: {supply: power_supply, source: current_source, chamber: thermal_chamber}
parameters:
  time: {help: how long the supply is on, default: 1 h}
setup:
  - {ramp: chamber, to: 60 °C, at: 1200 °C/min}
  - {set: supply, voltage: 15 V, current_limit: 120 mA, output: on}
  - {set: source, current: 5 mA, compliance: 10 V, output: on}
  - wait: 2 s
steps:
  - wait: ${time}
  - {measure: supply.voltage, for: 1 s, limits: {min: 14 V}}
teardown:
  - wait: 2 s
  - {set: source, output: off}
  - {set: supply, output: off}
"""
SET_POINT = 2782  # register of the chamber's controller
HOT_C, SAFE_C = 60.0, 25.0
SAFE = {"chamber": SAFE_C, "supply": False, "source": False}
ENERGISED = {"chamber": HOT_C, "supply": True, "source": True}
PROCESS_S, FOLLOWERS_END_S = 60.0, 30.0


class Wires:
    """The served bench: `energise` leaves it as a crash would, `state` is what its instruments say themselves."""

    def __init__(self, bench: Path) -> None:
        self.bench = bench
        self._at = {role: entry.connection for role, entry in load_bench(bench).bench.devices.items()}

    def edited(self, folder: Path, role: str, edit: Callable[[str], str]) -> Path:
        """Another bench file in which the lines of a device are edited."""
        lines, inside = self.bench.read_text("utf-8").splitlines(), False
        for number, line in enumerate(lines):
            inside = line == f"  {role}:" or (inside and line.startswith("    "))
            lines[number] = edit(line) if inside else line
        config = folder / "config"
        shutil.copytree(self.bench.parent, config, dirs_exist_ok=True)
        path = config / self.bench.name
        path.write_text("\n".join(lines) + "\n", "utf-8")
        return path

    def energise(self) -> None:
        """60 °C, 15 V and 5 mA."""
        self._set_chamber(HOT_C)
        self.switch_supply_on()
        self._source("CURR 0.005;:OUTP ON;:OUTP?")

    def switch_supply_on(self) -> None:
        """15 V at the unit."""
        self._supply("VOLT 15;:CURR 0.12;:OUTP ON;:OUTP?")

    def state(self) -> dict[str, float | bool]:
        """The set point in °C, and whether the outputs are on."""
        return {role: self.state_of(role) for role in SAFE}

    def state_of(self, role: str) -> float | bool:
        """That of one of them."""
        if role != "chamber":
            return (self._supply if role == "supply" else self._source)("OUTP?").strip() == "1"
        low, high = struct.unpack(">HH", self._modbus(struct.pack(">BHH", 3, SET_POINT, 2))[2:6])
        return float(round(struct.unpack(">f", struct.pack(">HH", high, low))[0], 2))

    def supply_v(self) -> float:
        """Voltage measured by the supply at its terminals."""
        return float(self._supply("MEAS:VOLT?"))

    def make_safe(self, role: str) -> None:
        """Make the bench safe by hand."""
        if role == "chamber":
            self._set_chamber(SAFE_C)
        elif role == "supply":
            self._supply("OUTP OFF;:OUTP?")
        elif role == "source":
            self._source("OUTP OFF;:OUTP?")

    def _set_chamber(self, set_point_c: float) -> None:
        high, low = struct.unpack(">HH", struct.pack(">f", set_point_c))
        self._modbus(struct.pack(">BHHBHH", 16, SET_POINT, 2, 4, low, high))

    def _modbus(self, request: bytes) -> bytes:
        with self._connected("chamber") as client:
            client.sendall(struct.pack(">HHHB", 7, 0, len(request) + 1, 1) + request)
            return client.recv(256)[7:]

    def _supply(self, line: str) -> str:
        with self._connected("supply") as client:
            client.sendall(line.encode() + b"\n")
            return client.recv(256).decode()

    @contextmanager
    def _connected(self, role: str) -> Iterator[socket.socket]:
        at = self._at[role]
        with socket.create_connection((at.host, at.port), timeout=5) as client:
            yield client

    def _source(self, line: str) -> str:
        with serial.Serial(self._at["source"].path, 19200, timeout=2) as client:
            client.reset_input_buffer()
            client.write(line.encode() + b"\r\n")
            return client.readline().decode()


@contextmanager
def wires(folder: Path, *options: str) -> Iterator[Wires]:
    """The bench on free ports, served by a process of its own with more options of `bench simulate`."""
    bench = on_real_wires(folder)
    with simulating(bench, *options):
        try:
            yield Wires(bench)
        finally:
            end_following(bench)


def end_following(bench: Path) -> None:
    """End the guardians that look at the chambers of a bench, and wait until they have ended."""
    addresses, end_s = energising_addresses(load_bench(bench).bench).values(), time.monotonic() + FOLLOWERS_END_S
    while found := owners(addresses, LOOKS):
        for each in found:
            with contextlib.suppress(ProcessLookupError):
                os.kill(each.process, signal.SIGTERM)
        assert time.monotonic() < end_s, found
        time.sleep(0.1)


class Process:
    """`bench run` of a sequence, that above, as a process of its own."""

    def __init__(
        self, bench: Path, folder: Path, *arguments: str, program: Sequence[str] = ("-m", "bench"),
        text: str | None = None, **options: Any,
    ) -> None:  # fmt: skip
        folder.mkdir(parents=True, exist_ok=True)
        sequence = folder / "energised.yaml"
        sequence.write_text(SEQUENCE if text is None else text, "utf-8")
        self.runs = folder / "runs"
        self.told = folder / "told.txt"
        command = [sys.executable, *program, "run", str(sequence), "--bench", str(bench), "--runs", str(self.runs)]
        command += ["--uut", "QF-0001", *arguments]
        with self.told.open("wb") as told:
            settings = {"stdin": subprocess.DEVNULL, "stdout": told, "stderr": told, "cwd": ROOT, **options}
            self.process = subprocess.Popen(command, **settings)

    @property
    def path(self) -> Path | None:
        """Its run directory, once there is one."""
        return next(iter(self.runs.glob("*")), None)

    def manifest(self) -> dict[str, Any]:
        """Manifest of its run."""
        assert self.path is not None
        content: dict[str, Any] = json.loads((self.path / "manifest.json").read_text("utf-8"))
        return content

    def until(self, condition: Callable[[], object]) -> None:
        """Return when the condition is true, or the process has ended, or a minute has gone by.

        In the latter cases print what the process said, for a test that fails.
        """
        end_s = time.monotonic() + PROCESS_S
        while time.monotonic() < end_s and self.process.poll() is None:
            with contextlib.suppress(Exception):  # what is not there yet
                if condition():
                    return
            time.sleep(0.02)
        print(self.told.read_text("utf-8", "replace"))

    def until_step(self, step: str) -> None:
        """Return when a step has begun."""
        self.until(lambda: step in self._begun())

    def _begun(self) -> list[str]:
        assert self.path is not None
        with RunReader(self.path) as reader:
            return [event.step for event in reader.events("step_begins")]

    def kinds(self) -> set[str]:
        """The kinds of the entries of its journal until now."""
        assert self.path is not None
        with RunReader(self.path) as reader:
            return {event.kind for event in reader.events()}

    def send(self, *numbers: signal.Signals) -> None:
        """Signals one after the other, as a hand or a shell sends them."""
        for number in numbers:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.process.pid, number)
            time.sleep(0.3)

    def code(self) -> int | None:
        """Its exit code; None, after killing it, where it does not end. Prints what it said, for a test that fails."""
        try:
            return self.process.wait(PROCESS_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            return None
        finally:
            print(self.told.read_text("utf-8", "replace"))
