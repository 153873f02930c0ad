"""The driver of the Watlow F4T makes the simulated one safe, whatever has happened before."""

import asyncio
from typing import Any

import pytest

from bench.loop import BenchLoop
from drivers.dialects.watlow_f4t.wire import ControlMode, LoopRegister
from drivers.errors import CannotConnect, DriverError, InstrumentFault, LinkLost, NoAnswer, NotSettled
from drivers.transport.memory import Line
from tests.support.chamber import ADDRESS, WRITES, Chamber, is_write_to, with_chamber, words


def test_make_safe_commands_the_safe_temperature_and_does_not_wait() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver(safe={"temperature": "28 °C"}) as driver:
            await driver.ramp_to(20.0, 1.0)
            began_s = chamber.now_s()
            await driver.make_safe()
            await driver.make_safe()
            assert chamber.now_s() - began_s < 0.1
            await asyncio.sleep(240.0)
            assert chamber.look()[0] == pytest.approx(24.0, abs=0.01)  # by the ramp as it was
            state = await driver.state()
            assert state.target_c == 28.0

    with_chamber(use)


@pytest.mark.parametrize("cancelled_after_ms", [*range(0, 60, 3), 30_000])
def test_make_safe_has_the_last_word_over_a_ramp_that_was_just_cancelled(cancelled_after_ms: int) -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            ramp = asyncio.create_task(driver.ramp_to(90.0, 1.0))
            await asyncio.sleep(cancelled_after_ms / 1000)
            ramp.cancel()
            began_s = chamber.now_s()
            await driver.make_safe()
            assert chamber.now_s() - began_s < 0.2
            with pytest.raises(asyncio.CancelledError):
                await ramp
            assert chamber.writes_to(LoopRegister.SET_POINT)[-1].endswith(bytes.fromhex("0000 41c8"))
            await asyncio.sleep(1.0)
            assert (await driver.state()).target_c == 25.0

    with_chamber(use)


def test_make_safe_has_the_last_word_over_a_ramp_that_goes_on() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            ramp = asyncio.create_task(driver.ramp_to(90.0, 1.0))
            await asyncio.sleep(0.02)
            await driver.make_safe()
            with pytest.raises(NotSettled, match="replaced by another command"):
                await ramp
            assert (await driver.state()).target_c == 25.0

    with_chamber(use)


@pytest.mark.parametrize("pause_s", [0.0, 5.0])
def test_make_safe_reconnects_after_a_lost_connection(pause_s: float) -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            ramp = asyncio.create_task(driver.ramp_to(90.0, 3.0))
            await asyncio.sleep(100.2)
            chamber.drop_connections()
            await asyncio.sleep(pause_s)
            began_s = chamber.now_s()
            await driver.make_safe()
            assert chamber.now_s() - began_s < 0.2
            assert len(chamber.connections) == 2
            assert len(chamber.writes_to(LoopRegister.SET_POINT)) == 2
            with pytest.raises(LinkLost if pause_s else NotSettled):
                await ramp
            assert (await driver.state()).target_c == 25.0

    with_chamber(use)


@pytest.mark.parametrize(("fault", "problem"), [("silent", NoAnswer), ("cut", LinkLost)])
def test_make_safe_says_within_its_time_that_it_could_not(fault: Any, problem: type[DriverError]) -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            chamber.faults.begin(fault)
            began_s = chamber.now_s()
            with pytest.raises(problem, match="chamber: "):
                await driver.make_safe()
            assert chamber.now_s() - began_s <= 10.01

    with_chamber(use)


def test_make_safe_says_so_when_nobody_is_at_the_address_any_more() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            loop = asyncio.get_running_loop()
            assert isinstance(loop, BenchLoop)
            chamber.drop_connections()
            loop.serve_in_memory(ADDRESS.host, ADDRESS.port, Gone, Line(latency_s=0.002))
            with pytest.raises(CannotConnect):
                await driver.make_safe()

    class Gone(asyncio.Protocol):
        def __init__(self) -> None:
            raise ConnectionRefusedError

    with_chamber(use)


def test_make_safe_heals_when_the_silence_ends() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            chamber.lose = lambda _request: chamber.now_s() < 5.0
            with pytest.raises(NoAnswer):
                await driver.poll()
            await driver.make_safe()
            assert (await driver.state()).target_c == 25.0

    with_chamber(use)


def test_make_safe_sends_a_set_point_whose_answer_is_lost_once() -> None:
    async def use(chamber: Chamber) -> None:
        chamber.leave_unanswered = is_write_to(LoopRegister.SET_POINT)
        async with chamber.driver() as driver:
            await driver.make_safe()
            assert len(chamber.writes_to(LoopRegister.SET_POINT)) == 1
            await driver.poll()

    with_chamber(use)


@pytest.mark.parametrize("set_point_read_back", [True, False])
def test_make_safe_sends_a_lost_set_point_again_only_after_reading_back(set_point_read_back: bool) -> None:
    async def use(chamber: Chamber) -> None:
        """The first write is lost; in the second case the connection breaks under the first read-back, too."""
        written: list[bytes] = []

        def lose(request: bytes) -> bool:
            if is_write_to(LoopRegister.SET_POINT)(request):
                written.append(request)
                return len(written) == 1
            if request[8:10] == b"\x0a\xde" and not set_point_read_back and len(chamber.connections) == 2:
                chamber.drop_connections()
                return True
            return False

        async with chamber.driver() as driver:
            chamber.lose = lose
            await driver.make_safe()
            assert len(written) == 2
            first, second = (chamber.requests.index(request) for request in written)
            between = [request[8:10] for request in chamber.requests[first + 1 : second] if request[7] == 3]
            assert between[-1] == b"\x0a\xde"  # the set point, read just before the second write
            assert (await driver.state()).target_c == 25.0

    with_chamber(use)


def test_make_safe_does_not_write_again_when_the_second_look_finds_it_done() -> None:
    async def use(chamber: Chamber) -> None:
        def leave_unanswered(request: bytes) -> bool:
            if is_write_to(LoopRegister.SET_POINT)(request):
                return True
            if request[8:10] == b"\x0a\xde" and len(chamber.connections) == 2:
                chamber.drop_connections()
            return False

        async with chamber.driver() as driver:
            chamber.leave_unanswered = leave_unanswered
            await driver.make_safe()
            assert len(chamber.writes_to(LoopRegister.SET_POINT)) == 1
            assert (await driver.state()).target_c == 25.0

    with_chamber(use)


@pytest.mark.parametrize(("mode", "safe"), [(ControlMode.OFF, True), (ControlMode.MANUAL, False)])
def test_make_safe_is_content_with_a_loop_that_is_off_and_not_with_manual_power(mode: ControlMode, safe: bool) -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            chamber.write_behind_its_back(LoopRegister.CONTROL_MODE, (mode,))
            if safe:
                await driver.make_safe()
            else:
                with pytest.raises(InstrumentFault, match="mode manual"):
                    await driver.make_safe()
            assert chamber.instrument.read(LoopRegister.SET_POINT, 2) == list(words(25.0))

    with_chamber(use)


def test_make_safe_can_be_cancelled() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            chamber.faults.begin("silent")
            making_safe = asyncio.create_task(driver.make_safe())
            await asyncio.sleep(1.0)
            making_safe.cancel()
            with pytest.raises(asyncio.CancelledError):
                await making_safe

    with_chamber(use)


def test_leaving_closes_the_connection_and_changes_nothing_else() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            await driver.ramp_to(22.0, 2.0)
            written = [request for request in chamber.requests if request[7] in WRITES]
        await asyncio.sleep(1.0)
        assert [request for request in chamber.requests if request[7] in WRITES] == written
        assert chamber.look()[0] == 22.0
        assert all(tap._transport is None or tap._transport.is_closing() for tap in chamber.connections)

    with_chamber(use)
