"""The driver of described controllers against the simulator of their profiles: what a profile makes of it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from drivers.description import known_drivers
from drivers.dialects.modbus_chamber.description import DESCRIPTION, ModbusChamberOptions
from drivers.errors import BadAnswer, CannotConnect, InstrumentFault, Refused, WrongIdentity
from drivers.schema.fields import DocumentFile
from simulators.instruments.chambers.modbus_chamber import SimulatedProfile
from tests.support.chambers import Dialect, Rig, with_rig
from tests.support.chambers_modbus import FICTIONAL, PROFILE_DIALECTS, writes


def dialect(name: str) -> Dialect:
    return next(each for each in PROFILE_DIALECTS if str(each) == f"profile-{name}")


SERIAL, PLAIN, HOURLY = (dialect(name) for name in ("fictional-serial", "plain", "hourly"))


def written(rig: Rig) -> list[int]:
    """The registers that were written, in order, on a serial line."""
    return [int.from_bytes(request[2:4], "big") for request in rig.wire.requests if writes()(request)]


def with_simulator(kind: Dialect, use: Any, simulator: type[SimulatedProfile]) -> None:
    async def main(rig: Rig) -> None:
        profile = rig.options.profile.content
        rig.wire.instrument = rig.instrument = simulator(rig.world, rig.faults, profile, serial_line=True)
        await use(rig)

    with_rig(kind, main)


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["modbus_chamber"] is DESCRIPTION


@pytest.mark.parametrize(
    ("kind", "names", "fingerprint"),
    [
        (
            SERIAL, ("Fictional Instruments", "FC-1"),
            "the model code is that of an FC-1, the display unit is °C, set point -70 to 180 °C",
        ),
        (PLAIN, ("Nobody", "Plain"), "it is a Plain"),
        (HOURLY, ("Nobody", "Hourly"), "set point -70 to 180 °C"),
    ],
    ids=str,
)  # fmt: skip
def test_its_names_are_stated_and_its_fingerprint_is_what_the_wire_tells(
    kind: Dialect, names: tuple[str, str], fingerprint: str
) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            identity = await driver.identify()
        assert ((identity.maker, identity.model), identity.fingerprint) == (names, fingerprint)
        assert not identity.verified

    with_rig(kind, use)


def test_a_profile_that_is_gone_is_told_when_the_device_is_made() -> None:
    async def use(rig: Rig) -> None:
        gone = DocumentFile(Path("gone.yaml"), None)
        rig.options = rig.options.model_copy(update={"profile": gone})
        with pytest.raises(CannotConnect, match=r"the profile gone\.yaml of its controller is gone"):
            rig.driver()

    with_rig(PLAIN, use)


def test_its_gap_is_kept_on_a_serial_line() -> None:
    slow = FICTIONAL.model_copy(update={"gap": 0.5})

    async def use(rig: Rig) -> None:
        rig.options = ModbusChamberOptions.model_validate({"profile": DocumentFile(Path("slow.yaml"), slow)})
        async with rig.driver() as driver:
            began_s, asked = rig.now_s(), len(rig.wire.requests)
            await driver.poll()
            assert rig.now_s() - began_s > 0.5 * (len(rig.wire.requests) - asked - 1)

    with_rig(SERIAL, use)


# Who is there


@pytest.mark.parametrize(
    ("held", "problem"),
    [
        ({0: (1,)}, r"wrong value: the model code is .*read 1 register at 0; received 1, expected 4711"),
        ({40: (0,)}, r"wrong value: the display unit is °C; .*received 0, expected 1"),
        ({110: (500,), 111: (500,)}, r"set-point limits of the controller are implausible; received 50 to 50 °C"),
    ],
)  # fmt: skip
def test_what_must_hold_and_does_not_is_another_controller(held: dict[int, tuple[int, ...]], problem: str) -> None:
    class Other(SimulatedProfile):
        def read(self, address: int, count: int) -> Sequence[int]:
            return held.get(address) or super().read(address, count)

    async def use(rig: Rig) -> None:
        with pytest.raises(WrongIdentity, match=problem):
            await rig.driver().__aenter__()
        assert written(rig) == []

    with_simulator(SERIAL, use, Other)


def test_a_process_value_that_is_no_temperature_is_another_controller() -> None:
    class Hot(SimulatedProfile):
        def measured_c(self) -> float:
            return 3000.0

    async def use(rig: Rig) -> None:
        with pytest.raises(WrongIdentity, match=r"process value is implausible; received 3000 °C.*types and word o"):
            await rig.driver().__aenter__()

    with_simulator(SERIAL, use, Hot)


def test_limits_that_changed_are_another_controller() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.instrument.limits_c = (-50.0, 120.0)
            with pytest.raises(WrongIdentity, match="another controller than before"):
                await driver.identify()

    with_rig(HOURLY, use)


# Ramps


def test_a_rate_per_hour_is_told_per_hour_and_the_ramp_is_its_own() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            began_s = rig.now_s()
            await driver.ramp_to(21.0, 0.5)
            assert rig.now_s() - began_s == pytest.approx(120.0, abs=2.0)
            assert rig.instrument.read(12, 2) == [0, 3000]
            assert written(rig) == [12, 2]

    with_rig(HOURLY, use)


def test_its_own_ramp_is_switched_on_after_its_rate_and_before_the_set_point() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(21.0, 2.0)
            assert written(rig) == [130, 131, 100]

    with_rig(SERIAL, use)


def test_a_rate_that_no_register_holds_is_refused_before_anything_is_sent() -> None:
    async def use(rig: Rig) -> None:
        assert FICTIONAL.ramp is not None
        coarse = FICTIONAL.ramp.rate.model_copy(update={"type": "int16", "scale": 1e-5})
        profile = FICTIONAL.model_copy(update={"ramp": FICTIONAL.ramp.model_copy(update={"rate": coarse})})
        rig.options = ModbusChamberOptions.model_validate({"profile": DocumentFile(Path("coarse.yaml"), profile)})
        async with rig.driver() as driver:
            with pytest.raises(
                Refused,
                match=r"no register can hold this ramp rate: 2 does not fit int16; nothing was s",
            ):
                await driver.ramp_to(21.0, 2.0)
            assert written(rig) == []

    with_rig(SERIAL, use)


def test_a_set_point_that_is_there_already_is_not_sent() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.make_safe()
            await driver.make_safe()
            assert written(rig) == [7]

    with_rig(PLAIN, use)


@pytest.mark.parametrize(
    ("kept", "received"),
    [((0x0000, 0x4248), r"received 50 \(0000 4248\)"), ((0, 0x7FC0), "received 0000 7fc0")],
)
def test_a_set_point_that_is_kept_as_another_is_told(kept: tuple[int, ...], received: str) -> None:
    class Locked(SimulatedProfile):
        def read(self, address: int, count: int) -> Sequence[int]:
            return kept if address == 100 else super().read(address, count)

    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            with pytest.raises(Refused, match=rf"sent 25 \(0000 41c8\); {received}"):
                await driver.make_safe()

    with_simulator(SERIAL, use, Locked)


# What the controller says of itself


@pytest.mark.parametrize(
    ("mode", "message"), [(3, "mode 3, a program is paused"), (9, "mode 9, which is not in the profile")]
)
def test_a_mode_has_the_name_of_the_profile(mode: int, message: str) -> None:
    async def use(rig: Rig) -> None:
        rig.instrument.mode = mode
        async with rig.driver() as driver:
            with pytest.raises(InstrumentFault, match=f"does not follow its set point; received {message}"):
                await driver.ramp_to(30.0, 1.0)
            assert written(rig) == []

    with_rig(SERIAL, use)


def test_without_a_start_value_only_a_person_may_take_control_back() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.instrument.take_over(2)
            with pytest.raises(InstrumentFault, match=r"received mode 2, a program runs.*Select its set-point mode"):
                await driver.make_safe()
            assert written(rig) == [2]

    with_rig(HOURLY, use)


def test_an_alarm_has_the_name_of_the_profile_and_is_not_acknowledged() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(20.2, 3.0)
            rig.instrument.alarms = [0, 2]  # which is quiet as well
            await driver.poll()
            rig.instrument.alarms = [7, 1]
            with pytest.raises(InstrumentFault, match=r"received over-temperature \(7\), the door is open \(1\)"):
                await driver.poll()
            with pytest.raises(InstrumentFault, match=r"the controller has an alarm; received over-temper"):
                await driver.make_safe()

    with_rig(SERIAL, use)


def test_a_controller_without_a_mode_always_follows() -> None:
    async def use(rig: Rig) -> None:
        profile = rig.options.profile.content.model_copy(update={"mode": None})
        rig.options = ModbusChamberOptions.model_validate({"profile": DocumentFile(Path("no_mode.yaml"), profile)})
        async with rig.driver() as driver:
            await driver.ramp_to(20.5, 3.0)
            assert written(rig) == [7]

    with_rig(PLAIN, use)


def test_a_number_that_is_not_finite_is_a_bad_answer() -> None:
    class Broken(SimulatedProfile):
        broken = False

        def read(self, address: int, count: int) -> Sequence[int]:
            return (0, 0x7F80) if address == 102 and self.broken else super().read(address, count)

    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.instrument.broken = True
            with pytest.raises(
                BadAnswer, match=r"inf is not a finite number.*read 2 registers at 102; received 0000 7f"
            ):
                await driver.poll()

    with_simulator(SERIAL, use, Broken)


def test_a_controller_that_was_switched_off_and_on_has_another_set_point() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(20.5, 3.0)
            rig.faults.begin("restart")
            with pytest.raises(InstrumentFault, match=r"received set point 25 °C now"):
                await driver.poll()

    with_rig(SERIAL, use)
