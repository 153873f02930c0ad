"""Benches at which a person works: recorded, refused to runs, made safe by switching off and stopping alone."""

from __future__ import annotations

import asyncio
import json
import threading
from pathlib import Path
from typing import Any

import pytest

from bench.app.devices import open_devices
from bench.app.execute import execute
from bench.app.laboratory import make_laboratory, unit_files
from bench.app.request import RunRequest, prepare
from bench.cli.main import main
from bench.clock import wall_utc
from bench.config.bench import load_bench
from bench.errors import InputError, InUseError
from bench.lanes import Lane, make_safe_in_lanes
from bench.loop import AS_FAST_AS_POSSIBLE
from bench.loop import run as run_loop
from bench.rig import Rig, limits_to_make_safe
from bench.runner import held
from bench.runner.held import real_addresses, why_locked_out
from bench.runner.quiet import Quiet
from bench.store.lockout import lift, lock_out, lockouts
from tests.support.runs import copy_bench
from tests.support.served import on_real_wires


@pytest.fixture(autouse=True)
def state(own_state) -> Path:
    return own_state


@pytest.fixture
def bench(tmp_path) -> Path:
    """A bench with real connections, at which nothing answers."""
    return on_real_wires(tmp_path)


def locked(bench: Path, by: str = "A. Person", reason: str = "the coil is changed") -> None:
    connections = {role: str(address) for role, address in real_addresses(load_bench(bench).bench).items()}
    lock_out(bench, wall_utc(), by, reason, connections)


def test_who_and_why_are_on_record(bench, state):
    locked(bench)
    (found,) = lockouts()
    assert (found.by, found.reason, found.bench) == ("A. Person", "the coil is changed", str(bench.resolve()))
    assert why_locked_out(load_bench(bench).bench).startswith("locked out by A. Person since 2")
    lift(bench, wall_utc(), "B. Person", "done")
    assert why_locked_out(load_bench(bench).bench) == ""
    log = [json.loads(line) for line in (state / "lockouts.jsonl").read_text("utf-8").splitlines()]
    assert [(entry["what"], entry["by"], entry["reason"], entry["bench"]) for entry in log] == [
        ("set", "A. Person", "the coil is changed", str(bench.resolve())),
        ("lifted", "B. Person", "done", str(bench.resolve())),
    ]


def test_another_file_with_the_same_instruments_is_locked_out_too(bench, tmp_path):
    locked(bench)
    other = bench.with_name("other.yaml")
    other.write_bytes(bench.read_bytes())
    assert why_locked_out(load_bench(other).bench)


def test_a_simulated_bench_is_not_locked_out_by_a_record_that_cannot_be_read(bench, state, tmp_path):
    locked(bench)
    (record,) = (state / "lockouts").glob("*.json")
    record.write_text("{", "utf-8")
    assert "is not known" in why_locked_out(load_bench(bench).bench)
    assert why_locked_out(load_bench(copy_bench(tmp_path / "simulated")).bench) == ""


def test_no_run_begins(bench, tmp_path):
    locked(bench)
    prepared = prepare(RunRequest("smoke", bench=str(bench), units=("QF-0001",), runs=tmp_path / "runs"))
    with pytest.raises(InUseError, match=r"The bench is locked out by A\. Person .*coil.* bench lockout --lift"):
        execute(prepared, Quiet())
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(("by", "reason"), [("", "x"), ("A", " "), ("A", "a\x1bb"), ("A" * 101, "x"), ("A", "x" * 501)])
def test_a_name_and_a_reason_are_needed(bench, by, reason):
    with pytest.raises(InputError, match=r"--by: expected|--reason: expected"):
        locked(bench, by, reason)
    assert list(lockouts()) == []


def test_on_the_command_line(bench, capsys):
    assert main(["lockout", "--bench", str(bench), "--lift", "--reason", "done"]) == 2
    assert "is not locked out" in capsys.readouterr().err
    locked(bench)
    assert main(["lockout"]) == 0
    assert "locked out by A. Person" in capsys.readouterr().out
    assert main(["lockout", "--bench", str(bench), "--lift", "--reason", "done"]) == 0
    assert main(["lockout"]) == 0
    assert capsys.readouterr().out == ""
    assert main(["lockout", "--bench", "simulated", "--reason", "x"]) == 2
    assert "there is nothing to lock out" in capsys.readouterr().err


def test_a_disk_that_does_not_answer_holds_no_making_safe_up(bench, monkeypatch):
    locked(bench)
    found, never = load_bench(bench).bench, threading.Event()
    assert held.is_locked_out(found)
    monkeypatch.setattr(held, "DISK_ANSWERS_S", 0.05)
    monkeypatch.setattr(held, "locked_out", lambda _addresses: str(never.wait(30)))
    assert not held.is_locked_out(found)
    never.set()
    (looking,) = (each for each in threading.enumerate() if each.name == "lockout")
    looking.join(5)


def energised(tmp_path: Path, use: Any) -> Any:
    """What `use` makes of the devices of a simulated bench whose chamber ramps and whose outputs are on."""
    bench = load_bench(copy_bench(tmp_path / "config")).bench

    async def work() -> Any:
        laboratory = make_laboratory(bench, unit_files(bench, None), 1, asyncio.get_running_loop().time)
        devices = open_devices(bench, laboratory)
        async with Rig(devices) as rig:
            await rig.source("supply").set(15.0, limit=0.12, output=True)
            ramp = asyncio.create_task(rig.chamber("chamber").ramp_to(60.0, 1.0))
            await asyncio.sleep(600)
            ramp.cancel()
            await asyncio.gather(ramp, return_exceptions=True)
        return await use(bench, open_devices(bench, laboratory), laboratory.world)

    return run_loop(work(), AS_FAST_AS_POSSIBLE)


def test_a_chamber_of_a_locked_bench_stops_where_it_is_and_is_not_called_safe(tmp_path):
    async def use(bench, devices, world):
        lanes = await make_safe_in_lanes(devices, limits_to_make_safe(bench), lambda _: None, only_off=True)
        before_c = world.thermal.set_point_c
        await asyncio.sleep(3600)
        world.look()
        return {lane.role: lane for lane in lanes}, before_c, world.thermal.set_point_c

    lanes, before_c, after_c = energised(tmp_path, use)
    assert {role for role, lane in lanes.items() if lane.state == "safe"} == {"supply", "source", "head", "counter"}
    chamber: Lane = lanes["chamber"]
    assert chamber.state == "unsafe"
    assert "since somebody works at the bench" in chamber.why
    assert 28.0 < before_c == after_c < 32.0  # of a ramp from 20 °C to 60 °C


def test_a_run_that_ends_meanwhile_does_the_same(tmp_path):
    async def use(bench, devices, world):
        async with Rig(devices, limits_to_make_safe(bench), lambda: True) as rig:
            return await rig.make_safe(), world.thermal.set_point_c

    unsafe, set_point_c = energised(tmp_path, use)
    assert unsafe.keys() == {"chamber"}
    assert 28.0 < set_point_c < 32.0
