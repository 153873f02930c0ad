"""What ends in the middle of something else: a second reason to end, a mistake of the program, a failure beside it."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from types import SimpleNamespace

import pytest

from bench.engine import stepper
from bench.engine.control import StepUnderWay
from bench.engine.outputs import _take_frames, acquire_into
from bench.engine.stepper import Stepper
from bench.errors import StoreError
from bench.loop import AS_FAST_AS_POSSIBLE, run
from bench.rig import OpenError, Rig
from bench.runner.quiet import Quiet
from bench.store.writer import RunWriter
from drivers.errors import LinkLost, NoAnswer, WrongIdentity
from drivers.values import Identity
from tests.support.engines import run_plan
from tests.support.sequences import BENCH, plan_of, steps


class Fake:
    """A device that does what it is told to do by functions."""

    def __init__(self, opened=None, made_safe=None) -> None:
        self._opened, self._made_safe = opened, made_safe
        self.is_open = self.is_safe = False

    async def __aenter__(self) -> Fake:
        await asyncio.sleep(1)
        if self._opened is not None:
            await self._opened()
        self.is_open = True
        return self

    async def __aexit__(self, *exc: object) -> None:
        self.is_open = False

    async def identify(self) -> Identity:
        return Identity(maker="m", model="m", serial="1", firmware="1")

    async def make_safe(self) -> None:
        await asyncio.sleep(1)
        if self._made_safe is not None:
            self._made_safe()
        self.is_safe = True


def slip() -> None:
    raise struct.error("unpack requires a buffer of 4 bytes")


async def stuck() -> None:
    await asyncio.sleep(3600)


def test_a_mistake_in_one_driver_does_not_keep_the_others_from_being_made_safe():
    rig = Rig({"bad": Fake(made_safe=slip), "supply": (supply := Fake())})
    assert run(rig.make_safe(), AS_FAST_AS_POSSIBLE) == {"bad": "bad: error: unpack requires a buffer of 4 bytes"}
    assert supply.is_safe


def test_no_device_stays_open_when_another_cannot_be_opened():
    async def slipped() -> None:
        slip()

    async def main() -> None:
        async with Rig({"supply": supply, "bad": Fake(opened=slipped)}):
            pytest.fail("it is open")

    supply = Fake()
    with pytest.raises(OpenError, match="bad: error: unpack requires"):
        run(main(), AS_FAST_AS_POSSIBLE)
    assert not supply.is_open


@pytest.mark.parametrize("needed", [("supply",), ("supply", "other")])
def test_nothing_is_sent_to_an_exchanged_instrument_and_what_opened_can_be_made_safe(needed):
    async def exchanged() -> None:
        raise WrongIdentity("other", "serial is '2'")

    async def main() -> None:
        try:
            await rig.open(needed)
            assert "other" not in needed
        except OpenError:
            assert "other" in needed
        assert await rig.make_safe() == {}
        await rig.close()

    rig = Rig({"supply": (supply := Fake()), "other": (other := Fake(opened=exchanged))})
    run(main(), AS_FAST_AS_POSSIBLE)
    assert (supply.is_safe, supply.is_open) == (True, False)
    assert (other.is_safe, other.is_open) == (False, False)
    assert rig.not_reached == {"other": "other: serial is '2'"}


@pytest.mark.leaves("a driver that does not end")
def test_a_driver_that_does_not_end_holds_up_neither_the_others_nor_the_end():
    async def deaf() -> None:
        while True:
            with contextlib.suppress(asyncio.CancelledError):
                await asyncio.sleep(600)

    class Deaf(Fake):
        async def make_safe(self) -> None:
            await deaf()

        async def __aexit__(self, *exc: object) -> None:
            await deaf()

    async def main() -> float:
        async with Rig({"supply": supply, "deaf": Deaf()}) as rig:
            unsafe.update(await rig.make_safe())
        return asyncio.get_running_loop().time()

    supply, unsafe = Fake(), {}
    assert run(main(), AS_FAST_AS_POSSIBLE) < 30
    assert supply.is_safe
    assert list(unsafe) == ["deaf"]


def test_no_device_stays_open_when_the_opening_is_cancelled():
    async def main() -> None:
        opening = asyncio.create_task(Rig({"supply": supply, "slow": Fake(opened=stuck)}).__aenter__())
        await asyncio.sleep(5)
        assert supply.is_open
        opening.cancel()
        await asyncio.wait([opening])

    supply = Fake()
    run(main(), AS_FAST_AS_POSSIBLE)
    assert not supply.is_open


def test_a_step_that_is_ending_already_is_not_cut_again():
    async def main() -> list[bool]:
        limit = asyncio.timeout(3600)
        under_way, cuts = StepUnderWay(SimpleNamespace(), limit), []

        async def step() -> None:
            try:
                async with limit:
                    await stuck()
            except TimeoutError:
                await asyncio.sleep(2)  # what it has set going comes to rest

        task = asyncio.create_task(step())
        for _ in range(2):
            await asyncio.sleep(1)
            cuts.append(under_way.cut("hold"))
        await task
        return cuts

    assert run(main(), AS_FAST_AS_POSSIBLE) == [True, False]


def test_a_mistake_while_a_device_is_watched_ends_the_run(tmp_path, monkeypatch):
    def slipped(_self, name, reading) -> None:
        if reading.at_s > 60:
            raise KeyError(name)

    monkeypatch.setattr(Quiet, "reading", slipped)
    ran = run_plan(tmp_path / "run", plan_of(tmp_path, steps("wait: 1 h")), BENCH)
    assert ran.outcome.how == "error"
    assert ran.outcome.problems[0].startswith("an internal error of this program: ")
    assert ran.events[-1].at_s < 120


def test_a_stop_while_others_end_beside_a_failure_is_not_lost():
    class Frames:
        def __init__(self, silent: bool) -> None:
            self._silent = silent

        @asynccontextmanager
        async def acquire(self, *, block_s: float | None) -> AsyncIterator[AsyncIterator[object]]:
            async def blocks() -> AsyncIterator[object]:
                await asyncio.sleep(1 if self._silent else 3600)
                raise NoAnswer("counter", "no frames")
                yield

            yield blocks()
            await asyncio.sleep(0)

    class Slow(Frames):
        @asynccontextmanager
        async def acquire(self, *, block_s: float | None) -> AsyncIterator[AsyncIterator[object]]:
            try:
                async with super().acquire(block_s=block_s) as blocks:
                    yield blocks
            finally:
                await asyncio.sleep(5)  # for its last block

    async def main() -> bool:
        devices = {"counter": Frames(silent=True), "other": Slow(silent=False)}
        rig = SimpleNamespace(devices=devices, frame_source=devices.__getitem__)

        async def sequence() -> None:
            with pytest.raises(NoAnswer):
                await acquire_into(devices, rig, [], stuck())

        task = asyncio.create_task(sequence())
        await asyncio.sleep(3)
        task.cancel("stopped by the operator")
        await asyncio.wait([task])
        return task.cancelled()

    assert run(main(), AS_FAST_AS_POSSIBLE)


@pytest.mark.parametrize(("aborting", "at_rest"), [(False, True), (True, False)])
def test_what_is_being_brought_to_rest_comes_to_rest_unless_the_run_is_aborted(monkeypatch, aborting, at_rest):
    rested = []

    async def commit() -> None:
        pass

    async def perform(*_: object) -> None:
        await stuck()

    async def leave(*_: object) -> None:
        await asyncio.sleep(3)
        rested.append(True)

    def write(*_: object, **__: object) -> None:
        pass

    async def main() -> None:
        monkeypatch.setattr(stepper, "perform", perform)
        monkeypatch.setattr(stepper, "leave", leave)
        journal = SimpleNamespace(write=write, try_to_write=write, commit=commit)
        control = SimpleNamespace(under_way={}, aborting=False)
        watcher = SimpleNamespace(step_begins=write, notice=write)
        planned = SimpleNamespace(id="turn", step=SimpleNamespace(timeout_s=None), waiting=None, phase="steps")
        bench = SimpleNamespace(journal=journal, rig=SimpleNamespace(safe_within_s=10.0), credit=None)
        task = asyncio.create_task(Stepper(SimpleNamespace(), bench, control, watcher, {"turn": 0}).step(planned))
        for cancelled_by in ("the operator", "the monitor"):
            await asyncio.sleep(1)
            control.aborting = aborting and cancelled_by == "the monitor"
            task.cancel(f"ended by {cancelled_by}")
        await asyncio.wait([task])
        assert task.cancelled()

    run(main(), AS_FAST_AS_POSSIBLE)
    assert bool(rested) == at_rest


def test_what_the_store_cannot_write_ends_the_run_and_not_the_answers(tmp_path):
    async def main() -> None:
        writer = RunWriter(tmp_path)
        writer.event("answered", by="\ud800")  # half of a character, which no file holds
        with pytest.raises(StoreError, match="cannot write"):
            await writer.commit()
        with pytest.raises(StoreError):
            writer.close()

    run(main(), AS_FAST_AS_POSSIBLE)


@pytest.mark.parametrize("turns", range(5))
def test_frames_that_fail_at_the_instant_of_a_cancellation_are_no_forgotten_error(turns):
    forgotten: list[object] = []
    tasks: list[asyncio.Task[None]] = []

    def cancel_after(turns: int) -> None:
        if turns:
            asyncio.get_running_loop().call_soon(cancel_after, turns - 1)
        else:
            tasks.pop().cancel()

    async def blocks():
        await asyncio.sleep(1.0)
        asyncio.get_running_loop().call_soon(cancel_after, turns)
        raise LinkLost("counter", "the connection was cut")
        yield

    @asynccontextmanager
    async def acquiring():
        yield blocks()

    async def main() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda _loop, context: forgotten.append(context))
        over: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        tasks.append(asyncio.create_task(_take_frames(acquiring(), lambda _: None, over)))
        await asyncio.gather(*tasks, return_exceptions=True)
        for _ in range(turns):
            await asyncio.sleep(0)
        gc.collect()
        await asyncio.sleep(0)

    run(main(), AS_FAST_AS_POSSIBLE)
    assert forgotten == []
