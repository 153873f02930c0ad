"""The driver of Binder's chambers against the simulated ones: the bench file, identity, order of writes, alarms."""

from collections.abc import Callable, Coroutine, Sequence
from typing import Any

import pytest
from pydantic import ValidationError

from drivers.description import known_drivers
from drivers.dialects.binder.description import DESCRIPTION, BinderOptions
from drivers.dialects.binder.wire import LINES, MODE, PROGRAM_STOP, Mode, words
from drivers.errors import BadAnswer, BeyondLimit, InstrumentFault, Refused, WrongIdentity
from simulators.instruments.chambers.binder import SimulatedBinder
from tests.support.chambers import Dialect, Rig, with_rig
from tests.support.chambers_modbus import BINDER_DIALECTS, writes

MB1, _, MB2 = BINDER_DIALECTS
RANGE = {"min": "-40 °C", "max": "180 °C"}
Use = Callable[[Rig], Coroutine[Any, Any, None]]


def with_binder(dialect: Dialect, use: Use, simulator: type[SimulatedBinder]) -> None:
    """Runs `use` with another kind of simulator."""

    async def main(rig: Rig) -> None:
        kind = rig.options.controller
        rig.wire.instrument = rig.instrument = simulator(rig.world, rig.faults, kind=kind)
        await use(rig)

    with_rig(dialect, main)


def written(rig: Rig) -> list[int]:
    """The registers that were written, in order."""
    return [int.from_bytes(request[2:4], "big") for request in rig.wire.requests if writes()(request)]


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["binder"] is DESCRIPTION


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        ({"range": RANGE}, "missing"),
        ({"controller": "mb1"}, "missing"),
        ({"controller": "mb3", "range": RANGE}, "'mb1' or 'mb2'"),
        ({"controller": "mb2", "range": RANGE, "set_point": "basic"}, "has the manual set point only"),
        ({"controller": "mb2", "range": RANGE, "swapped": True}, "has the manual set point only"),
        ({"controller": "mb1", "range": {"min": "20 °C", "max": "10 °C"}}, "min is not below max"),
    ],
)
def test_a_wrong_bench_file_is_told_what_is_wrong(data: Any, problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        BinderOptions.model_validate(data)


@pytest.mark.parametrize(("dialect", "model"), [(MB1, "MB1"), (MB2, "MB2")], ids=str)
def test_its_fingerprint_says_what_was_found(dialect: Dialect, model: str) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver(pin={"serial": "18-01234"}) as driver:
            identity = await driver.identify()
        assert (identity.maker, identity.model, identity.serial) == ("Binder", model, "18-01234")
        assert (identity.verified, identity.fingerprint) == (False, f"temperatures in the registers of an {model}")

    with_rig(dialect, use)


@pytest.mark.parametrize(
    ("answer", "received"),
    [
        ({0x11A9: (0x41A0, 0x0000)}, "2.35418e-41 °C is no temperature|received 41a0 0000"),
        ({0x11A9: (0x0000, 0x7FC0)}, "received 0000 7fc0"),
        ({MODE: (0x0003,)}, "received 0x3"),
    ],
)
def test_what_has_no_temperature_or_mode_there_is_no_mb1(answer: dict[int, tuple[int, ...]], received: str) -> None:
    class Odd(SimulatedBinder):
        def read(self, address: int, count: int) -> Sequence[int]:
            return answer.get(address) or super().read(address, count)

    async def use(rig: Rig) -> None:
        with pytest.raises(WrongIdentity, match=rf"do not fit an MB1.*({received}).*options\.controller"):
            await rig.driver().__aenter__()
        assert written(rig) == []

    with_binder(MB1, use, Odd)


def test_the_stated_range_is_the_limit_of_the_controller() -> None:
    async def use(rig: Rig) -> None:
        rig.options = BinderOptions.model_validate(
            {"controller": "mb1", "range": {"min": "-20 °C", "max": "60 °C"}}
        )  # fmt: skip
        async with rig.driver() as driver:
            with pytest.raises(BeyondLimit, match=r"61 °C is beyond the limits of the controller, -20 to 60 °C"):
                await driver.ramp_to(61.0, 1.0)

    with_rig(MB1, use)


# The order of writes


def test_the_set_point_is_written_before_the_mode() -> None:
    async def use(rig: Rig) -> None:
        rig.instrument.write(MODE, (Mode.IDLE,))
        async with rig.driver() as driver:
            await driver.ramp_to(20.2, 3.0)
            assert written(rig) == [0x1581, MODE]
            assert rig.set_point_c() == pytest.approx(20.2)

    with_rig(MB1, use)


def test_where_the_mode_is_there_it_is_told_again_after_every_set_point() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(21.0, 3.0)
            assert written(rig) == [0x1581, MODE] * 2

    with_rig(MB1, use)


def test_making_an_idle_chamber_safe_leaves_it_idle() -> None:
    async def use(rig: Rig) -> None:
        rig.instrument.write(MODE, (Mode.IDLE,))
        async with rig.driver() as driver:
            await driver.make_safe()
            assert written(rig) == [0x1581]

    with_rig(MB1, use)


def test_an_idle_mb2_is_woken_with_its_other_lines_kept() -> None:
    async def use(rig: Rig) -> None:
        rig.instrument.write(LINES, (0b100_0010,))
        async with rig.driver() as driver:
            await driver.ramp_to(20.2, 3.0)
            assert written(rig) == [0x114C, LINES]
            assert rig.instrument.read(LINES, 1) == [0b100_0000]

    with_rig(MB2, use)


def test_an_mb2_in_a_program_is_taken_back_by_stopping_it() -> None:
    async def use(rig: Rig) -> None:
        rig.instrument.start_program()
        async with rig.driver() as driver:
            with pytest.raises(InstrumentFault, match=r"active set point .*, manual set point 20 °C: a program may"):
                await driver.ramp_to(30.0, 1.0)
            await driver.make_safe()
            assert written(rig) == [0x114C, PROGRAM_STOP]
            assert rig.set_point_c() == 25.0

    with_rig(MB2, use)


def test_a_program_is_stopped_once_when_that_has_no_answer() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.instrument.start_program()
            rig.wire.alter = lambda request, answer: b"" if writes(PROGRAM_STOP)(request) else answer
            await driver.make_safe()
            assert written(rig) == [0x114C, PROGRAM_STOP]

    with_rig(MB2, use)


def test_an_mb2_whose_program_goes_on_is_told() -> None:
    class Stubborn(SimulatedBinder):
        def _write_word(self, address: int, words: Sequence[int]) -> None:
            """It takes no notice."""

    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.instrument.start_program()
            with pytest.raises(InstrumentFault, match=r"does not follow its set point.*Stop the program at the contr"):
                await driver.make_safe()

    with_binder(MB2, use, Stubborn)


# What the controller says of itself


def test_an_alarm_is_told_and_never_acknowledged() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(20.2, 3.0)
            rig.instrument.alarm = 4
            with pytest.raises(InstrumentFault, match="does not follow its set point; received alarm 0x4"):
                await driver.poll()
            with pytest.raises(InstrumentFault, match=r"has an alarm; received 0x4.*acknowledge it at the controller"):
                await driver.make_safe()
            assert set(written(rig)) == {0x1581, MODE}
            assert rig.set_point_c() == 25.0

    with_rig(MB1, use)


def test_a_mode_that_nobody_knows_is_told_as_it_is() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(20.2, 3.0)
            rig.instrument._mode = 0x2000
            with pytest.raises(InstrumentFault, match=r"received mode unknown \(0x2000\)"):
                await driver.poll()

    with_rig(MB1, use)


def test_a_process_value_that_is_no_temperature_is_a_bad_answer() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.instrument.measured_c = lambda: 3e4
            with pytest.raises(BadAnswer, match=r"30000 °C is no temperature; sent read 2 registers at 0x11a9"):
                await driver.poll()

    with_rig(MB1, use)


@pytest.mark.parametrize(("kept", "received"), [(words(50.0), "received 50 °C"), ((0, 0x7FC0), "received 0000 7fc0")])
def test_a_set_point_that_is_kept_as_another_is_told(kept: tuple[int, ...], received: str) -> None:
    class Locked(SimulatedBinder):
        locked = False

        def read(self, address: int, count: int) -> Sequence[int]:
            return kept if address == 0x1581 and self.locked else super().read(address, count)

    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.instrument.locked = True
            with pytest.raises(Refused, match=rf"sent 25 °C \(0000 41c8\); {received}"):
                await driver.make_safe()

    with_binder(MB1, use, Locked)


def test_a_controller_that_was_switched_off_and_on_has_another_set_point() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(20.2, 3.0)
            rig.faults.begin("restart")
            with pytest.raises(InstrumentFault, match=r"received set point 25 °C now"):
                await driver.poll()

    with_rig(MB1, use)
