"""The driver of the Fluke 5700A: faults and the safe state."""

import asyncio

import pytest

from drivers.dialects.fluke_5700a.driver import Fluke5700A
from drivers.dialects.fluke_5700a.wire import Status
from drivers.errors import BadAnswer, CannotConnect, InstrumentFault, NoAnswer, NotSettled, Refused
from simulators.instruments.sources.fluke_5700a import ILLEGAL_LIMIT
from tests.support.calibrator import Calibrator, now_s, with_calibrator, with_driver

CUT_IN = b"REMOTE\r\nOUT 0 A, 0 HZ\r\nSTBY\r\n"

# Faults


def test_an_output_that_does_not_settle_is_an_error_in_time() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        source.instrument.settle_s = 1e9
        begun_s = now_s()
        with pytest.raises(NotSettled, match=r"not settled within 15 s; received 0.0012 A, operating, remote"):
            await driver.set(0.0012, limit=10, output=True)
        assert 15 < now_s() - begun_s < 18

    with_driver(use)


def test_faults_of_the_calibrator_are_quoted_until_its_queue_is_empty() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        source.instrument.fault(ILLEGAL_LIMIT)
        source.instrument.fault(902)
        with pytest.raises(Refused, match="received 725 ILLEGAL LIMIT SETTING; 902 BAD PARAMETER"):
            await driver.set(0.0012, limit=10, output=True)
        await driver.set(0.0012, limit=10, output=True)

    with_driver(use)


def test_faults_of_before_it_was_connected_are_forgotten() -> None:
    async def use(source: Calibrator) -> None:
        for _ in range(20):
            source.instrument.fault(ILLEGAL_LIMIT)
        async with source.driver() as driver:
            await driver.poll()
            await driver.set(0.0012, limit=10, output=True)

    with_calibrator(use)


def test_a_fault_queue_without_an_end_is_an_error() -> None:
    async def use(source: Calibrator) -> None:
        source.wire.alter = lambda request, answer: b"725\r\n" if b"FAULT" in request else answer
        with pytest.raises(Refused, match="does not become empty; received 725 ILLEGAL LIMIT SETTING"):
            await source.driver().__aenter__()

    with_calibrator(use)


def test_a_fault_while_it_settles_is_told() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        setting = asyncio.create_task(driver.set(0.0012, limit=10, output=True))
        await asyncio.sleep(3)
        source.instrument.fault(ILLEGAL_LIMIT)
        with pytest.raises(InstrumentFault, match="725 ILLEGAL LIMIT SETTING"):
            await setting

    with_driver(use)


def test_a_fault_at_any_other_time_is_told_within_one_poll() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.poll()
        source.instrument.fault(ILLEGAL_LIMIT)
        with pytest.raises(InstrumentFault, match="725 ILLEGAL LIMIT SETTING"):
            await driver.poll()
        await driver.poll()

    with_driver(use)


def test_a_level_that_the_calibrator_does_not_take_is_refused_with_its_reason() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.set(0.0012, limit=10, output=True)
        source.instrument.range_a = 0.0022  # somebody has locked another range
        with pytest.raises(Refused, match=r"sent OUT 0.0144 A, 0 HZ; received 903 OUTSIDE LOCKED RANGE"):
            await driver.set(0.0144, limit=10, output=True)
        assert source.instrument.current_a == 0.0012

    with_driver(use)


def test_an_open_load_is_a_fault_when_it_operates() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        with pytest.raises((InstrumentFault, Refused), match="904 OUTPUT OVERLOAD"):
            await driver.set(0.0012, limit=10, output=True)
        await driver.make_safe()
        await driver.poll()

    with_driver(use, load_ohm=1e9)


def test_a_load_that_opens_while_it_settles_is_a_fault() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        setting = asyncio.create_task(driver.set(0.0012, limit=10, output=True))
        await asyncio.sleep(3)
        source.instrument.load_ohm = 1e9
        with pytest.raises(InstrumentFault, match=r"was set to 0.0012 A, operating; received .*standby.* 904 OUTPUT"):
            await setting

    with_driver(use)


def test_a_load_that_opens_later_is_a_fault_within_one_poll() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.set(0.0012, limit=10, output=True)
        await driver.poll()
        source.instrument.load_ohm = 1e9
        await asyncio.sleep(1)
        source.instrument.execute("ISR?")  # it trips
        await asyncio.sleep(1)
        with pytest.raises(InstrumentFault, match=r"in standby.*904 OUTPUT OVERLOAD.*open or too large load"):
            await driver.poll()
        with pytest.raises(InstrumentFault, match="in standby"):
            await driver.poll()

    with_driver(use)


@pytest.mark.parametrize("command", [b"OUT 0.002 A, 0 HZ", b"STBY", b"RANGELCK OFF", b"*RST", b"OUT 1 V, 0 HZ"])
def test_a_second_master_is_a_fault_within_one_poll(command: bytes) -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.set(0.0012, limit=10, output=True)
        source.at_the_panel(command)
        await asyncio.sleep(1)
        with pytest.raises(InstrumentFault, match=r"was set to 0.0012 A, operating.*another master"):
            await driver.poll()

    with_driver(use)


def test_a_person_who_takes_it_to_local_is_a_fault_and_keeps_it() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.set(0.0012, limit=10, output=True)
        source.instrument.local()
        with pytest.raises(InstrumentFault, match="switched to local control"):
            await driver.poll()
        with pytest.raises(InstrumentFault, match="switched to local control"):
            await driver.set(0.0144, limit=10, output=True)
        assert source.instrument.current_a == 0.0012
        await driver.make_safe()  # which is for everybody's good
        assert source.instrument.current_a == 0

    with_driver(use)


def test_a_power_failure_is_a_fault_within_one_poll() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.set(0.0012, limit=10, output=True)
        source.instrument.restart()
        with pytest.raises(InstrumentFault, match="switched off"):
            await driver.poll()
        await driver.make_safe()
        source.instrument.restart()
        with pytest.raises(InstrumentFault, match=r"was set to 0 A, in standby; received no DC current, .*local"):
            await driver.poll()
        await driver.set(0.0012, limit=10, output=False)

    with_driver(use)


@pytest.mark.parametrize(
    ("mode", "words"),
    [(Status.OFFSET, "an offset is added"), (Status.SCALE, "a scale error"), (Status.BOOST, "an amplifier is on")],
)
def test_what_changes_the_meaning_of_a_level_is_a_fault(mode: Status, words: str) -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        source.instrument.modes = mode
        await driver.poll()  # nothing is to flow
        with pytest.raises(InstrumentFault, match=words):
            await driver.set(0.0012, limit=10, output=True)
        assert source.commands() == []
        source.instrument.modes = Status(0)
        await driver.set(0.0012, limit=10, output=True)
        source.instrument.modes = mode
        with pytest.raises(InstrumentFault, match=words):
            await driver.poll()

    with_driver(use)


# The line


def test_a_calibrator_that_is_busy_is_silent_in_time_and_heard_again() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.set(0.0012, limit=10, output=True)
        source.instrument.busy = True
        begun_s = now_s()
        with pytest.raises(NoAnswer, match="no answer within 5 s"):
            await driver.poll()
        assert now_s() - begun_s < 12  # it is asked twice
        source.go_on()
        assert (await driver.poll())["current"][0].value == 0.0012  # what comes late is drained

    with_driver(use)


def test_a_calibrator_that_stays_busy_asks_for_a_pause_and_is_heard_again() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        message = bytearray()
        source.wire.alter = lambda _request, answer: message.extend(answer) or answer
        source.instrument.busy = True
        for _ in range(8):
            with pytest.raises((NoAnswer, BadAnswer)):
                await driver.poll()
        assert message == b"\x13"
        source.go_on()
        await driver.poll()
        assert b"\x11" in message

    with_driver(use)


def test_flow_characters_in_an_answer_are_no_number() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        source.wire.alter = lambda request, answer: b"\x13" + answer if b"ISR" in request else answer
        with pytest.raises(BadAnswer, match="an invalid answer"):
            await driver.poll()
        source.wire.alter = lambda _request, answer: answer
        await driver.poll()

    with_driver(use)


def test_an_answer_that_is_cut_is_not_believed() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.set(0.0012, limit=10, output=True)
        source.wire.alter = lambda request, answer: b"1.2000\r\n" if b"OUT?" in request else answer
        with pytest.raises(BadAnswer, match="not amplitude,unit,frequency"):
            await driver.poll()

    with_driver(use)


# The safe state


def test_making_safe_goes_to_zero_then_to_standby_and_proves_it() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.set(0.0012, limit=10, output=True)
        source.wire.requests.clear()
        await driver.make_safe()
        assert source.wire.requests[0] == CUT_IN
        assert (source.instrument.level, source.instrument.output) == (0, False)
        assert source.wire.requests[-2:] == [b"ISR?\r\n", b"OUT?\r\n"]
        await driver.make_safe()
        await driver.poll()
        source.at_the_panel(b"OPER")
        await asyncio.sleep(1)
        with pytest.raises(InstrumentFault, match=r"was set to 0 A, in standby; received 0 A, operating"):
            await driver.poll()

    with_driver(use)


STATES = {
    "operating in another range": [b"OUT 0.15 A, 0 HZ", b"OPER"],
    "a voltage": [b"OUT 10 V, 0 HZ", b"OPER"],
    "a voltage in standby": [b"OUT 10 V, 0 HZ"],
    "an alternating current": [b"OUT 0.01 A, 50 HZ", b"OPER"],
    "a level in standby": [b"OUT 0.01 A, 0 HZ"],
    "as switched on": [],
}


@pytest.mark.parametrize("commands", STATES.values(), ids=STATES)
@pytest.mark.parametrize("relay_s", [0.0, 0.1, 1.0])
def test_it_is_made_safe_from_any_state_in_time(commands: list[bytes], relay_s: float) -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        source.instrument.relay_s = relay_s
        source.at_the_panel(b"RANGELCK OFF", *commands)
        source.instrument.fault(ILLEGAL_LIMIT)
        await asyncio.sleep(2)
        begun_s = now_s()
        await driver.make_safe()
        assert now_s() - begun_s < 5
        assert not source.instrument.output
        assert source.instrument.unit == "V" or source.instrument.level == 0
        assert not (await driver.read()).output

    with_driver(use, load_ohm=1.0)


def test_it_is_made_safe_though_its_first_commands_are_lost() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.set(0.0012, limit=10, output=True)
        source.wire.requests.clear()
        source.wire.lose = lambda request: request == CUT_IN
        source.instrument.fault(ILLEGAL_LIMIT)
        await driver.make_safe()
        assert source.commands()[3:] == [b"OUT 0 A, 0 HZ", b"STBY"]
        assert not source.instrument.output

    with_driver(use)


def test_making_safe_is_at_once_though_a_question_is_not_answered() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.set(0.0012, limit=10, output=True)
        source.wire.mute(b"ISR")
        poll = asyncio.create_task(driver.poll())
        await asyncio.sleep(0.5)
        start_s = now_s()
        safe = asyncio.create_task(driver.make_safe())
        await asyncio.sleep(0.06)
        assert source.instrument.current_a == 0
        source.wire.alter = lambda _request, answer: answer
        await safe
        assert now_s() - start_s < 5
        with pytest.raises(Refused, match="aborted, the instrument"):
            await poll

    with_driver(use)


@pytest.mark.parametrize("requests", range(1, 26))
@pytest.mark.parametrize("later_s", [0.0, 0.01, 0.05])
def test_making_safe_ends_a_setting_wherever_it_is(requests: int, later_s: float) -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        opened = len(source.wire.requests)
        setting = asyncio.create_task(driver.set(0.0012, limit=10, output=True))
        await source.wire.heard(opened + requests)
        await asyncio.sleep(later_s)
        start_s = now_s()
        await driver.make_safe()
        assert now_s() - start_s < 5
        await asyncio.gather(setting, return_exceptions=True)
        assert (source.instrument.level, source.instrument.output) == (0, False)
        safe = source.wire.requests.index(CUT_IN)
        assert not [request for request in source.wire.requests[safe:] if b"OPER" in request]

    with_driver(use)


def test_making_safe_connects_and_identifies_again() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.set(0.0012, limit=10, output=True)
        source.wire.drop()
        await asyncio.sleep(0.1)
        start_s = now_s()
        await driver.make_safe()
        assert source.instrument.current_a == 0
        assert now_s() - start_s < 5
        assert len(source.wire.connections) == 2
        source.at_the_panel(b"RANGELCK OFF;OUT 0.1 A, 0 HZ;RANGELCK ON;OUT 0 A, 0 HZ")  # while nobody looked
        await driver.set(0.0012, limit=10, output=True)
        assert source.instrument.range_a == 0.022

    with_driver(use)


def test_what_cannot_be_made_safe_says_so_in_time() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.set(0.0012, limit=10, output=True)
        source.faults.begin("stuck")
        start_s = now_s()
        with pytest.raises(Refused, match="not executed; sent OUT 0 A, 0 HZ"):
            await driver.make_safe()
        assert now_s() - start_s <= 5
        source.instrument.terminal = True
        with pytest.raises((BadAnswer, NoAnswer)):
            await driver.make_safe()
        source.instrument.terminal = False
        source.faults.begin("silent")
        start_s = now_s()
        with pytest.raises(NoAnswer, match="not proved safe within 5 s"):
            await driver.make_safe()
        assert now_s() - start_s <= 5
        source.wire.drop()
        source.wire.broken = True
        await asyncio.sleep(0.1)
        with pytest.raises(CannotConnect):
            await driver.make_safe()

    with_driver(use)
