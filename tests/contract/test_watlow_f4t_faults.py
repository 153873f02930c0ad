"""The driver of the Watlow F4T against a simulated one that fails, is silent, or obeys somebody else."""

import asyncio
import math
from collections.abc import Sequence

import pytest

from drivers.dialects.watlow_f4t.wire import ControlMode, LoopRegister
from drivers.errors import BadAnswer, InstrumentFault, LinkLost, NoAnswer, Refused, WrongIdentity
from drivers.kinds.chamber.ramp import FAR_AWAY_POLL_S
from drivers.transport.modbus import ModbusLink
from drivers.transport.wires import RealWires
from simulators.instruments.chambers.watlow_f4t import SimulatedF4T
from simulators.instruments.modbus import ExceptionCode, RegisterError
from tests.support.chamber import ADDRESS, WRITES, Chamber, is_write_to, with_chamber, words

# Settings that do not arrive


@pytest.mark.parametrize("code", ExceptionCode)
def test_an_exception_ends_the_ramp_and_nothing_is_asked_again(code: ExceptionCode) -> None:
    class Refusing(SimulatedF4T):
        def write(self, address: int, words: Sequence[int]) -> None:
            if address == LoopRegister.SET_POINT:
                raise RegisterError(code)
            super().write(address, words)

    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            with pytest.raises(Refused, match=rf"Modbus exception {code.value}, .*sent write 0000 41f0 at 2782"):
                await driver.ramp_to(30.0, 1.0)
            assert len(chamber.writes_to(LoopRegister.SET_POINT)) == 1
            await driver.poll()

    with_chamber(use, simulator=Refusing)


def test_a_controller_that_refuses_blocks_says_so() -> None:
    class Singles(SimulatedF4T):
        def read(self, address: int, count: int) -> Sequence[int]:
            if count > 2:
                raise RegisterError(ExceptionCode.ILLEGAL_ADDRESS)
            return super().read(address, count)

    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            with pytest.raises(Refused, match=r"Modbus exception 2, .*sent read 12 registers at 2810"):
                await driver.poll()
        async with chamber.driver(block_reads=False) as driver:
            assert (await driver.state()).set_point_c == 20.0

    with_chamber(use, simulator=Singles)


def test_a_set_point_that_sticks_is_seen_before_the_ramp_begins() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            chamber.faults.begin("stuck")
            with pytest.raises(Refused, match=r"new set point .*sent 30 \(0000 41f0\); received 20 \(0000 41a0\)"):
                await driver.ramp_to(30.0, 1.0)
            with pytest.raises(Refused, match="set point"):
                await driver.make_safe()

    with_chamber(use)


@pytest.mark.parametrize(
    ("kept", "received"),
    [((62,), r"sent 85; received 62"), ((0x0000, 0x7FC0), r"sent 1 \(0000 3f80\); received 0000 7fc0")],
)
def test_a_setting_that_is_kept_as_something_else_is_told(kept: tuple[int, ...], received: str) -> None:
    register = LoopRegister.RAMP_ACTION if len(kept) == 1 else LoopRegister.RAMP_RATE

    class Locked(SimulatedF4T):
        def read(self, address: int, count: int) -> Sequence[int]:
            return kept if address == register else super().read(address, count)

    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            with pytest.raises(Refused, match=received):
                await driver.ramp_to(30.0, 1.0)
            assert chamber.writes_to(LoopRegister.SET_POINT) == []

    with_chamber(use, simulator=Locked)


WRITTEN_IN_A_RAMP = [
    LoopRegister.RAMP_SCALE, LoopRegister.RAMP_RATE, LoopRegister.RAMP_ACTION, LoopRegister.SET_POINT,
]  # fmt: skip


@pytest.mark.parametrize("register", WRITTEN_IN_A_RAMP)
def test_a_write_whose_answer_is_lost_was_done_and_is_not_sent_twice(register: LoopRegister) -> None:
    async def use(chamber: Chamber) -> None:
        chamber.leave_unanswered = is_write_to(register)
        async with chamber.driver() as driver:
            await driver.ramp_to(22.0, 1.0)
            assert [len(chamber.writes_to(each)) for each in WRITTEN_IN_A_RAMP] == [1, 1, 1, 1]
            assert chamber.look()[0] == 22.0

    with_chamber(use)


@pytest.mark.parametrize("register", WRITTEN_IN_A_RAMP)
def test_a_write_that_is_lost_is_told_and_not_sent_twice(register: LoopRegister) -> None:
    async def use(chamber: Chamber) -> None:
        chamber.lose = is_write_to(register)
        async with chamber.driver() as driver:
            with pytest.raises(NoAnswer, match=rf"no answer within 3 s .*at {register.value}"):
                await driver.ramp_to(22.0, 1.0)
            assert len(chamber.writes_to(register)) == 1
            assert chamber.look()[0] == 20.0

    with_chamber(use)


def test_a_read_whose_answer_is_lost_is_asked_again_on_a_new_connection() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            unanswered = [True]
            chamber.lose = lambda request: request[8:10] == b"\x0a\xfa" and bool(unanswered) and unanswered.pop()
            await driver.poll()
            assert chamber.now_s() == pytest.approx(3.0, abs=0.1)
            assert len(chamber.connections) == 2
            chamber.faults.begin("silent")
            with pytest.raises(NoAnswer):
                await driver.poll()

    with_chamber(use)


# Faults on the way


def test_a_foreign_set_point_is_seen_by_the_next_look_and_names_both() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            await driver.poll()
            ramp = asyncio.create_task(driver.ramp_to(30.0, 1.0))
            await asyncio.sleep(100.5)
            second_master = ModbusLink("web page", RealWires(), ADDRESS, unit_id=1)
            await second_master.open()
            await second_master.write(LoopRegister.SET_POINT, words(50.0))
            second_master.close()
            with pytest.raises(InstrumentFault, match="set point 30 °C before; received set point 50 °C now"):
                await driver.poll()
            with pytest.raises(InstrumentFault, match="another master changed the set point"):
                await ramp
            assert chamber.now_s() < 100.5 + FAR_AWAY_POLL_S
            await driver.make_safe()
            assert (await driver.state()).target_c == 25.0

    with_chamber(use)


@pytest.mark.parametrize("cancelled_after_ms", range(0, 50, 2))
def test_a_set_point_of_a_ramp_that_was_cut_short_is_not_called_foreign(cancelled_after_ms: int) -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            await driver.ramp_to(20.0, 1.0)
            ramp = asyncio.create_task(driver.ramp_to(90.0, 1.0))
            await asyncio.sleep(cancelled_after_ms / 1000)
            ramp.cancel()
            with pytest.raises(asyncio.CancelledError):
                await ramp
            await driver.poll()

    with_chamber(use)


def test_a_loop_that_is_switched_off_in_a_ramp_is_seen() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            ramp = asyncio.create_task(driver.ramp_to(30.0, 1.0))
            await asyncio.sleep(60.0)
            chamber.write_behind_its_back(LoopRegister.CONTROL_MODE, (ControlMode.OFF,))
            with pytest.raises(InstrumentFault, match="mode off"):
                await ramp
            assert chamber.now_s() < 62.5

    with_chamber(use)


def test_a_frozen_process_value_is_seen_ten_minutes_into_a_ramp() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            ramp = asyncio.create_task(driver.ramp_to(30.0, 0.1))
            await asyncio.sleep(100.0)
            chamber.faults.begin("frozen")
            with pytest.raises(InstrumentFault, match=r"not changed for 10 min of a moving set point"):
                await ramp
            assert chamber.now_s() == pytest.approx(700.0, abs=FAR_AWAY_POLL_S)
            await driver.make_safe()

    with_chamber(use)


def test_a_process_value_may_rest_while_the_set_point_rests() -> None:
    async def use(chamber: Chamber) -> None:
        chamber.faults.begin("frozen")
        async with chamber.driver() as driver:
            for _ in range(3600):
                await driver.poll()
                await asyncio.sleep(1.0)

    with_chamber(use)


def test_a_process_value_that_is_no_number_is_a_bad_answer() -> None:
    class Broken(SimulatedF4T):
        def measured_c(self) -> float:
            return math.inf

    async def use(chamber: Chamber) -> None:
        for block_reads in (True, False):
            async with chamber.driver(block_reads=block_reads) as driver:
                with pytest.raises(BadAnswer, match=r"inf is not a finite number.*0000 7f80"):
                    await driver.poll()

    with_chamber(use, simulator=Broken)


def test_silence_in_a_ramp_is_told_within_bounded_time() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            ramp = asyncio.create_task(driver.ramp_to(30.0, 1.0))
            await asyncio.sleep(100.0)
            chamber.faults.begin("silent")
            with pytest.raises(NoAnswer, match="chamber: no answer within 3 s from tcp://"):
                await ramp
            assert chamber.now_s() < 100.0 + 1.0 + 2 * 3.0 + 0.1

    with_chamber(use)


@pytest.mark.parametrize("request_number", range(1, 30))
def test_silence_from_any_request_on_is_told_within_bounded_time(request_number: int) -> None:
    async def use(chamber: Chamber) -> None:
        silent_since_s = []

        def lose(_request: bytes) -> bool:
            if len(chamber.requests) >= request_number:
                silent_since_s.append(chamber.now_s())
            return bool(silent_since_s)

        async def ramp_up_and_up() -> None:
            async with chamber.driver() as driver:
                for target_c in range(21, 100):
                    await driver.ramp_to(float(target_c), 3.0)

        chamber.lose = lose
        with pytest.raises(NoAnswer):
            await ramp_up_and_up()
        assert chamber.now_s() - silent_since_s[0] < 2 * 3.0 + 0.1
        assert len(silent_since_s) <= 2  # a read once more, or the question who is there

    with_chamber(use)


def test_a_cut_in_a_ramp_is_told_at_once() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            ramp = asyncio.create_task(driver.ramp_to(30.0, 1.0))
            await asyncio.sleep(100.0)
            chamber.faults.begin("cut")
            with pytest.raises(LinkLost, match=r"the connection to tcp://.* was closed"):
                await ramp
            assert chamber.now_s() < 101.5

    with_chamber(use)


def test_after_a_lost_connection_the_next_look_connects_and_identifies_again() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            chamber.drop_connections()
            await asyncio.sleep(1.0)
            with pytest.raises(LinkLost):
                await driver.poll()
            asked = len(chamber.requests)
            await driver.poll()
            registers = [int.from_bytes(request[8:10], "big") for request in chamber.requests[asked:]]
            assert registers == [6730, 2774, 2776, 2810, 2782]
            chamber.drop_connections()
            await asyncio.sleep(1.0)
            with pytest.raises(LinkLost):
                await driver.poll()
            await driver.identify()

    with_chamber(use)


def test_another_controller_behind_the_same_address_gets_no_command() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            chamber.drop_connections()
            chamber.instrument = SimulatedF4T(chamber.world, chamber.faults, set_point_limits_c=(-40.0, 180.0))
            for _ in range(2):  # the lost connection, then the other controller
                with pytest.raises((LinkLost, WrongIdentity)) as reported:
                    await driver.poll()
            assert "set points from -40 to 180 °C" in str(reported.value)
            with pytest.raises(WrongIdentity, match="another controller than before"):
                await driver.make_safe()
            assert not [request for request in chamber.requests if request[7] in WRITES]

    with_chamber(use)
