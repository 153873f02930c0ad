"""The driver of the Acutrol3000: faults, lost answers, stopping in any state."""

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from drivers.dialects.acutronic_acl.axis import AcutronicAcl
from drivers.dialects.acutronic_acl.wire import InterlockInput, SoftwareFault
from drivers.errors import BadAnswer, CannotConnect, InstrumentFault, NoAnswer, NotSettled, Refused
from tests.support.table import Table, framed, now_s, with_driver, with_table

NO_INPUTS = InterlockInput(0)

Motion = Callable[[AcutronicAcl], Awaitable[object]]
MOTIONS: dict[str, Motion] = {
    "move": lambda driver: driver.move_to(100, approach="direct", settle_s=0),
    "rotate": lambda driver: driver.rotate_at(50, acceleration_dps2=10),
    "oscillate": lambda driver: driver.oscillate(10, 0.5),
}
motions = pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)


# The interlock


@motions
def test_a_latched_fault_is_named_and_never_reset(motion: Motion) -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        await motion(driver)
        table.controller.trip(SoftwareFault.RATE_TRIP, InterlockInput.MASTER_INTERLOCK)
        words = "axis 1 has an interlock fault: rate trip, master interlock.*INTERLOCK:RESET"
        with pytest.raises(InstrumentFault, match=words):
            await driver.poll()
        with pytest.raises(InstrumentFault, match=words):
            await motion(driver)
        with pytest.raises(InstrumentFault, match=words):
            await driver.stop()
        await driver.make_safe()
        assert table.commands(":INTERLOCK:") == [":INTERLOCK:CLOSE 1"]

    with_driver(use)


@motions
def test_a_fault_during_a_motion_ends_it(motion: Motion) -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        asyncio.get_running_loop().call_later(1.5, table.controller.trip, SoftwareFault.TRACKING_ERROR, NO_INPUTS)
        with pytest.raises(InstrumentFault, match="tracking error"):
            await motion(driver)
        assert now_s() < 1.7

    with_driver(use)


def test_a_fault_without_a_reason_is_a_fault() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        table.controller.trip(SoftwareFault(0), NO_INPUTS)
        with pytest.raises(InstrumentFault, match="has an interlock fault: no reason reported"):
            await driver.poll()

    with_driver(use)


def test_a_fault_that_comes_just_before_a_command_is_told_with_it() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        def trip(request: bytes) -> bool:
            if request.startswith(b":MODE:RATE"):
                table.controller.trip(SoftwareFault.ABORT, NO_INPUTS)
            return False

        table.wire.lose = trip
        with pytest.raises(InstrumentFault, match="interlock fault: abort; sent :MODE:RATE 1"):
            await driver.rotate_at(50, acceleration_dps2=None)

    with_driver(use)


def test_a_drive_that_stays_off_is_refused() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        table.wire.lose = lambda request: request.startswith(b":INTERLOCK:CLOSE")
        with pytest.raises(
            Refused, match=r"stays off; sent :INTERLOCK:CLOSE 1; received interlock Open.*emergency stop"
        ):
            await driver.rotate_at(50, acceleration_dps2=None)
        assert len(table.commands(":INTERLOCK:CLOSE")) == 1
        assert not table.commands(":MODE:RATE")

    with_driver(use)


# Other hands


@motions
@pytest.mark.parametrize(
    ("message", "problem"),
    [
        (":INTERLOCK:OPEN 1", "the drive of the table was switched off"),
        (":MODE:OFF 1", "the table is in mode Off, commanded was (Position|Rate|Synthesis)"),
        (":UTIL:REMOTELOCKOUT OFF", "another master has taken control of the table"),
    ],
)
@pytest.mark.parametrize("after_s", [1.3, 60])
def test_what_others_do_to_it_is_a_fault(motion: Motion, message: str, problem: str, after_s: float) -> None:
    async def move_and_watch(driver: AcutronicAcl) -> None:
        await motion(driver)
        while now_s() < after_s + 2:
            await driver.poll()
            await asyncio.sleep(1)

    async def use(table: Table, driver: AcutronicAcl) -> None:
        asyncio.get_running_loop().call_later(after_s, table.demand_elsewhere, message)
        with pytest.raises(InstrumentFault, match=f"{problem}; received"):
            await move_and_watch(driver)

    with_driver(use)


def test_a_table_that_does_not_do_what_it_was_told_is_a_fault_within_one_poll() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        await driver.rotate_at(50, acceleration_dps2=None)
        table.demand_elsewhere(":DEM:RATE 1,50.5")
        await asyncio.sleep(1)
        await driver.poll()  # within ten bands
        table.demand_elsewhere(":DEM:RATE 1,51")
        await asyncio.sleep(1)
        with pytest.raises(InstrumentFault, match=r"does not turn at 50 °/s, as commanded; received .* 51\.00000 °/s"):
            await driver.poll()
        await driver.move_to(0, approach="direct", settle_s=0)
        table.demand_elsewhere(":DEM:POS 1,0.1")
        await asyncio.sleep(5)
        with pytest.raises(InstrumentFault, match=r"is not at 0°, its target; received 0\.10000°"):
            await driver.poll()
        await driver.oscillate(1, 1)
        table.wire.alter = lambda _request, answer: framed(answer[8:].replace(b";3072;", b";1024;"))
        with pytest.raises(InstrumentFault, match="does not swing by ±1°, as commanded"):
            await driver.poll()
        table.wire.alter = lambda _request, answer: answer
        await driver.stop()
        await driver.poll()

    with_driver(use)


def test_a_table_left_turning_by_others_is_stopped_before_it_is_used() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        table.demand_elsewhere(":INTERLOCK:CLOSE 1", ":MODE:RATE 1", ":DEM:RATE 1,80")
        await asyncio.sleep(2)
        await driver.poll()
        assert (await driver.move_to(0, approach="direct", settle_s=0)).value == 0
        assert not table.commands(":INTERLOCK:CLOSE")
        assert table.commands(":MODE:") == [":MODE:OFF 1", ":MODE:POSITION 1"]

    with_driver(use)


# Answers that are lost


@pytest.mark.parametrize("word", [b":MODE:RATE", b":DEM:RATE 1,50", b":INTERLOCK:CLOSE", b":MODE:OFF"])
@pytest.mark.parametrize("answer", [b"", framed(b"OK") + framed(b"OK"), framed(b"OK")[:9]], ids=["none", "two", "cut"])
def test_a_motion_whose_answer_is_lost_is_sent_once_and_decided_by_what_is_read_back(
    word: bytes, answer: bytes
) -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        table.wire.alter = lambda request, good: answer if request.startswith(word) else good
        await driver.rotate_at(50, acceleration_dps2=None)
        assert table.rate_dps == 50
        assert table.wire.count(word) == 1

    with_driver(use)


@pytest.mark.parametrize("word", [b":LIM:ACC R", b":DEM:RATE 1,0", b":UTIL:LOCKOUT"])
def test_a_setting_whose_answer_is_lost_ends_the_motion_before_it_begins(word: bytes) -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        table.wire.mute(word)
        with pytest.raises(NoAnswer):
            await driver.rotate_at(50, acceleration_dps2=None)
        assert not table.commands(":MODE:RATE")
        assert not table.moving

    with_driver(use)


def test_a_demand_that_never_arrived_is_not_repeated() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        table.wire.lose = lambda request: request.startswith(b":DEM:RATE 1,50")
        with pytest.raises(NotSettled, match=r"the rate of 50 °/s is not reached; received 0\.00000°, 0\.00000 °/s"):
            await driver.rotate_at(50, acceleration_dps2=None)
        assert table.wire.count(b":DEM:RATE 1,50") == 1

    with_driver(use)


@pytest.mark.parametrize(
    ("motion", "problem"),
    [
        ("move", "is not at 100°"),
        ("rotate", "the rate of 50 °/s is not reached"),
        ("oscillate", r"the sine of ±10° at 0\.5 Hz is not reached"),
    ],
)
def test_a_stuck_table_is_not_settled_in_time(motion: str, problem: str) -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        table.faults.begin("stuck")
        with pytest.raises(NotSettled, match=problem):
            await MOTIONS[motion](driver)
        assert 30 < now_s() < 45

    with_driver(use)


def test_readings_that_stand_still_are_not_settled() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        table.faults.begin("frozen")
        with pytest.raises(NotSettled, match=r"received 0\.00000°"):
            await driver.move_to(100, approach="direct", settle_s=0)

    with_driver(use)


def test_the_hold_begins_again_when_the_table_leaves_its_band() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        await driver.move_to(10, approach="direct", settle_s=0)
        asyncio.get_running_loop().call_later(0.6, table.demand_elsewhere, ":DEM:POS 1,10.1")
        asyncio.get_running_loop().call_later(0.9, table.demand_elsewhere, ":DEM:POS 1,10")
        start_s = now_s()
        await driver.move_to(10, approach="direct", settle_s=0)
        assert now_s() - start_s == pytest.approx(0.9 + 1.0, abs=0.25)

    with_driver(use)


def test_a_refused_command_is_quoted() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        table.wire.alter = lambda request, answer: framed(b"no", -5) if request.startswith(b":LIM") else answer
        with pytest.raises(Refused, match="refused a command; sent :LIM:RATE R,1,400; received error -5, 'no'"):
            await driver.rotate_at(50, acceleration_dps2=None)

    with_driver(use)


def test_a_refused_question_is_quoted() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        table.wire.alter = lambda _request, _answer: framed(b"", 9)
        with pytest.raises(Refused, match=r"sent :READ:POS\? 1.*received error 9, ''"):
            await driver.angle()

    with_driver(use)


def test_a_garbled_answer_is_an_error() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        table.wire.alter = lambda _request, _answer: framed(b"1.2.3;0;Close;Rate;0;0")
        with pytest.raises(BadAnswer, match=r"'1\.2\.3' is not a number; sent ':READ:POS\? 1"):
            await driver.angle()
        table.wire.alter = lambda _request, answer: answer
        assert (await driver.angle()).value == 0

    with_driver(use)


# Stopping and the safe state


def test_one_motion_ends_another() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        first = asyncio.create_task(driver.rotate_at(300, acceleration_dps2=50))
        await asyncio.sleep(3)
        assert (await driver.move_to(0, approach="direct", settle_s=0)).value == 0
        with pytest.raises(Refused, match="ended by another command"):
            await first

    with_driver(use)


def test_making_safe_stops_at_once_while_a_question_is_under_way() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        await driver.rotate_at(400, acceleration_dps2=None)
        table.wire.mute(b"READ")
        looking = asyncio.create_task(driver.poll())
        await asyncio.sleep(0.5)
        table.wire.alter = lambda _request, answer: answer
        start_s = now_s()
        await driver.make_safe()
        assert now_s() - start_s < 2.2
        assert not table.moving
        with pytest.raises(Refused, match="aborted, the instrument"):
            await looking

    with_driver(use)


def test_making_safe_is_idempotent_and_legal_in_any_state() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        await driver.make_safe()
        await driver.make_safe()
        table.controller.trip(SoftwareFault.COARSE_TRANSDUCER, NO_INPUTS)
        await driver.make_safe()
        assert set(table.commands()) == {":MODE:OFF 1"}

    with_driver(use)


def test_making_safe_connects_and_identifies_again() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        await driver.rotate_at(100, acceleration_dps2=None)
        table.wire.drop()
        await asyncio.sleep(1)
        assert table.moving
        await driver.make_safe()
        assert not table.moving
        assert len(table.wire.connections) == 2
        await driver.rate()

    with_driver(use)


def test_making_safe_before_it_was_ever_connected() -> None:
    async def use(table: Table) -> None:
        table.demand_elsewhere(":INTERLOCK:CLOSE 1", ":MODE:RATE 1", ":DEM:RATE 1,80")
        driver = table.driver()
        await driver.make_safe()
        assert not table.moving
        await driver.__aexit__()

    with_table(use)


def test_what_cannot_be_made_safe_says_so_in_time() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        table.faults.begin("silent")
        start_s = now_s()
        with pytest.raises(NoAnswer):
            await driver.make_safe()
        assert now_s() - start_s <= 5
        table.wire.drop()
        table.wire.broken = True
        await asyncio.sleep(0.1)
        with pytest.raises(CannotConnect):
            await driver.make_safe()

    with_driver(use)


def test_a_table_that_does_not_stop_is_not_proved_safe() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        await driver.rotate_at(100, acceleration_dps2=None)
        table.wire.lose = lambda request: request.startswith(b":MODE:OFF")
        start_s = now_s()
        with pytest.raises(NoAnswer, match="is not proved safe within 7 s"):
            await driver.make_safe()
        assert now_s() - start_s == pytest.approx(7)
        with pytest.raises(NotSettled, match=r"still turns after a stop; received .* 100\.00000 °/s.*emergency stop"):
            await driver.stop()

    with_driver(use)


def test_leaving_a_table_that_no_longer_answers_is_quiet_and_takes_no_long_time() -> None:
    async def use(table: Table) -> None:
        async with table.driver() as driver:
            await driver.rotate_at(100, acceleration_dps2=None)
            table.faults.begin("silent")
            start_s = now_s()
        assert now_s() - start_s < 3
        assert table.moving

    with_table(use)


async def work(driver: AcutronicAcl) -> None:
    async with driver:
        await driver.move_to(40, approach="from_above", settle_s=1)
        await driver.rotate_at(-90, acceleration_dps2=None)
        await driver.oscillate(1, 1)
        while True:
            await driver.poll()
            await asyncio.sleep(1)


@pytest.mark.parametrize("tens", range(15))
def test_silence_is_reported_within_a_deadline_whenever_it_begins(tens: int) -> None:
    for silent_from in range(10 * tens + 1, 10 * tens + 11):

        async def use(table: Table, silent_from: int = silent_from) -> None:
            silent_at_s: list[float] = []

            def lose(_request: bytes) -> bool:
                if len(table.wire.requests) >= silent_from:
                    silent_at_s.append(now_s())
                return bool(silent_at_s)

            table.wire.lose = lose
            with pytest.raises(NoAnswer):
                await work(table.driver())
            assert now_s() - silent_at_s[0] < 10

        with_table(use)
