"""A bench is made safe in lanes, in virtual time: broken instruments delay no other one."""

from __future__ import annotations

import asyncio

import pytest

from bench.app.devices import open_devices
from bench.app.laboratory import make_laboratory, unit_files
from bench.app.make_safe import make_safe
from bench.clock import wall_utc
from bench.config.bench import load_bench
from bench.lanes import Lane, longest_lane_s, make_safe_in_lanes
from bench.loop import AS_FAST_AS_POSSIBLE
from bench.loop import run as run_loop
from bench.rig import limits_to_make_safe
from bench.store.energised import note_energised, note_safe
from bench.store.runs import RunDirectory
from tests.support.runs import copy_bench

OTHERS = {"chamber", "counter", "head", "source"}


def lanes(folder, faults: str = "") -> dict[str, Lane]:
    bench = copy_bench(folder / "config", faults=faults)
    shown: list[Lane] = []
    found = list(make_safe(str(bench), lambda _text: None, shown.append))
    assert sorted(shown) == sorted(found)
    return {lane.role: lane for lane in found}


def test_every_instrument_of_a_healthy_bench_is_safe_within_seconds(tmp_path):
    found = lanes(tmp_path)
    assert {role: lane.state for role, lane in found.items()} == dict.fromkeys(OTHERS | {"supply"}, "safe")
    assert max(lane.took_s for lane in found.values()) < 5


@pytest.mark.parametrize("kind", ["silent", "cut", "garbage", "echo", "half_open"])
def test_one_that_is_broken_throughout_is_named_and_delays_no_other(tmp_path, kind):
    found = lanes(tmp_path, f"[{{device: supply, kind: {kind}, at: 0 s}}]")
    supply = found.pop("supply")
    assert {role: lane.state for role, lane in found.items()} == dict.fromkeys(OTHERS, "safe")
    assert max(lane.took_s for lane in found.values()) < 5
    assert supply.state != "safe"
    assert supply.why.startswith("supply")
    assert supply.took_s <= longest_lane_s({"supply": 7.0})


def test_one_that_comes_back_within_the_time_to_connect_is_made_safe(tmp_path):
    found = lanes(tmp_path, "[{device: supply, kind: silent, at: 0 s, for: 4 s}]")
    assert found["supply"].state == "safe"
    assert found["supply"].took_s > 4


def test_only_what_a_run_that_is_over_has_left_on(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    bench, run = copy_bench(tmp_path / "config"), tmp_path / "runs" / "earlier"
    message: list[str] = []

    def made_safe() -> list[Lane]:
        return list(make_safe(str(bench), message.append, lambda _lane: None, if_left_on=True))

    assert made_safe() == []
    assert "no run that is over has left an instrument on" in message[-1]
    note_energised(run, bench, wall_utc(), {"supply": "tcp://127.0.0.1:5025"})
    run.mkdir(parents=True)
    directory = RunDirectory.reopen(run)  # under way
    assert made_safe() == []
    directory.release()
    assert {lane.state for lane in made_safe()} == {"safe"}
    note_safe({"tcp://127.0.0.1:5025"})
    assert made_safe() == []


@pytest.mark.parametrize("at_s", [0.0, 0.02, 0.1, 0.3])
@pytest.mark.parametrize("role", ["supply", "source", "chamber"])
def test_an_instrument_that_restarts_meanwhile_is_made_safe(tmp_path, role, at_s):
    found = lanes(tmp_path, f"[{{device: {role}, kind: restart, at: {at_s} s}}]")
    assert found[role].state == "safe", found[role].why


@pytest.mark.parametrize("every_s", [0.05, 0.5])
def test_a_second_master_that_switches_on_again_is_not_called_safe(tmp_path, every_s):
    bench = load_bench(copy_bench(tmp_path / "config")).bench

    async def work() -> tuple[Lane, bool]:
        laboratory = make_laboratory(bench, unit_files(bench, None), 1, asyncio.get_running_loop().time)
        supply = laboratory.instruments["supply"]

        async def master() -> None:
            while True:
                supply.session().feed(b"VOLT 15;:OUTP ON\n")
                await asyncio.sleep(every_s)

        other = asyncio.create_task(master())
        found = await make_safe_in_lanes(open_devices(bench, laboratory), limits_to_make_safe(bench), lambda _: None)
        on = supply.output
        other.cancel()
        return next(lane for lane in found if lane.role == "supply"), on

    lane, on = run_loop(work(), AS_FAST_AS_POSSIBLE)
    assert (lane.state, on) == ("unsafe", True)
    assert "switched on again" in lane.why or "was not carried out" in lane.why
