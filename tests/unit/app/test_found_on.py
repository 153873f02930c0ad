"""What a run finds energised before it has commanded anything."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from bench.app.devices import open_devices
from bench.app.faults import FaultPlayer
from bench.app.laboratory import Laboratory, make_laboratory, unit_files
from bench.config.bench import load_bench
from bench.loop import AS_FAST_AS_POSSIBLE
from bench.loop import run as run_loop
from bench.rig import Rig
from bench.runner import found_on
from bench.runner.found_on import Found, found_energised
from drivers.values import ChamberState
from tests.support.runs import ROOT, copy_bench

Before = Callable[[Rig], Awaitable[object]]


def found(bench_file: Path, before: Before, then: Callable[[Laboratory], object] = lambda _: None) -> dict[str, Found]:
    """What is found by new drivers after somebody else has used the bench."""
    bench = load_bench(bench_file).bench

    async def work() -> dict[str, Found]:
        laboratory = make_laboratory(bench, unit_files(bench, None), 1, asyncio.get_running_loop().time)
        async with Rig(open_devices(bench, laboratory)) as rig:
            task = asyncio.ensure_future(before(rig))
            await asyncio.wait([task], timeout=900)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        async with Rig(open_devices(bench, laboratory)) as rig:
            then(laboratory)
            return await found_energised(rig, [role for role in bench.devices if role != "by_hand"])

    return run_loop(work(), AS_FAST_AS_POSSIBLE)


async def nothing(_rig: Rig) -> None:
    pass


@pytest.mark.parametrize("name", ["simulated", "rate_table", "every_dialect", "centrifuge", "imu_two_axis"])
def test_a_bench_at_rest_has_nothing_on(name):
    assert found(ROOT / "config" / f"{name}.yaml", nothing) == {}


def test_outputs_and_a_chamber_that_heats_are_found_with_their_values(tmp_path):
    async def energise(rig: Rig) -> None:
        await rig.source("supply").set(15.0, limit=0.12, output=True)
        await rig.source("source").set(0.005, limit=10.0, output=True)
        await rig.chamber("chamber").ramp_to(60.0, 1.0)

    what = found(copy_bench(tmp_path), energise)
    assert what.keys() == {"supply", "source", "chamber"}
    assert what["supply"].values["voltage_v"] == pytest.approx(15.0, abs=0.1)
    assert what["source"].values == {"current_a": pytest.approx(0.005)}
    assert what["chamber"].values["set_point_c"] == 60.0
    assert 20.0 < what["chamber"].values["process_value_c"] < 60.0
    assert [each.is_output for each in what.values()].count(False) == 1


def test_a_head_that_moves_is_found(tmp_path):
    async def move(rig: Rig) -> None:
        moving = asyncio.create_task(rig.positioner("head").move_to(180.0, approach="direct", settle_s=0.0))
        await asyncio.sleep(2.0)
        moving.cancel()

    slow = copy_bench(tmp_path, ("rate: 20 °/s", "rate: 5 °/s"))
    assert abs(found(slow, move)["head"].values["rate_dps"]) == pytest.approx(5.0, rel=0.05)


@pytest.mark.parametrize("rate_dps", [0.2, -30.0])
def test_a_table_that_turns_is_found(rate_dps):
    async def turn(rig: Rig) -> None:
        await rig.table("table").rotate_at(rate_dps, acceleration_dps2=None)

    what = found(ROOT / "config" / "rate_table.yaml", turn)
    assert what["table"].values["rate_dps"] == pytest.approx(rate_dps, rel=0.05)
    assert what["table"].text.startswith("moves at ")


def test_one_that_does_not_say_what_it_does_counts_as_energised(tmp_path):
    bench = copy_bench(tmp_path, faults="[{device: supply, kind: silent, at: 0 s}]")
    faults = load_bench(bench).bench.simulation.faults
    what = found(bench, nothing, lambda laboratory: FaultPlayer(laboratory, faults, lambda *_: None))
    assert what.keys() == {"supply"}
    assert what["supply"].is_output
    assert what["supply"].text.startswith("does not report its state")


@pytest.mark.parametrize(("from_safe_c", "is_found"), [(None, False), (0.0, False), (9.9, False), (10.0, True)])
def test_a_chamber_is_found_where_its_set_point_is_far_from_the_safe_one(from_safe_c, is_found):
    class Chamber:
        async def state(self) -> ChamberState:
            return ChamberState(30.0, 35.0, 35.0, from_safe_c)

    what = run_loop(found_on._temperature(Chamber()), AS_FAST_AS_POSSIBLE)
    assert (what is not None) == is_found
