"""The driver of a described rate table against the simulated one, in virtual time; asked, and sending by itself."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from drivers.capabilities import Approach, Positioner, RateTable
from drivers.description import IdentityPin, known_drivers
from drivers.dialects.framed.description import HEAD, TABLE
from drivers.dialects.framed.profile import ControllerLimits, FrameProfile
from drivers.errors import (
    BadAnswer,
    BeyondLimit,
    CannotConnect,
    InstrumentFault,
    LinkLost,
    NoAnswer,
    NotSettled,
    Refused,
    WrongIdentity,
)
from drivers.schema.fields import DocumentFile
from tests.support.capabilities import CAPABILITIES
from tests.support.framed import FICTIONAL, PLAIN, PLAIN_FILE, Framed, with_driver, with_framed
from tests.support.table import now_s

Motion = Callable[[Any], Awaitable[object]]
MOVE: Motion = lambda driver: driver.move_to(100, approach="direct", settle_s=0)  # noqa: E731
ROTATE: Motion = lambda driver: driver.rotate_at(50, acceleration_dps2=None)  # noqa: E731
OSCILLATE: Motion = lambda driver: driver.oscillate(10, 0.5)  # noqa: E731
both = pytest.mark.parametrize("profile", [FICTIONAL, PLAIN], ids=["asked", "cyclic"])
motions = pytest.mark.parametrize("motion", [MOVE, ROTATE, OSCILLATE], ids=["move", "rotate", "oscillate"])


def test_they_are_installed_under_their_names() -> None:
    assert (known_drivers()["framed_head"], known_drivers()["framed_table"]) == (HEAD, TABLE)
    assert HEAD.capabilities == {"positioner"}
    assert TABLE.capabilities == {"positioner", "rate_table"} <= CAPABILITIES.keys()


@both
def test_looking_at_it_changes_nothing(profile: FrameProfile) -> None:
    async def use(framed: Framed, driver: Any) -> None:
        assert isinstance(driver, Positioner)
        assert isinstance(driver, RateTable)
        assert (await driver.poll()).keys() == {"angle", "rate"}
        assert ((await driver.angle()).value, (await driver.rate()).value) == (0, 0)
        assert [name for name in profile.command_names() if framed.sent(name)] == []

    with_driver(use, profile)


# Who is there


def test_a_serial_number_that_the_status_tells_is_compared_and_one_that_it_does_not_is_stated() -> None:
    async def told(framed: Framed) -> None:
        async with framed.driver(IdentityPin(serial="1001")) as driver:
            identity = await driver.identify()
            assert (identity.maker, identity.model, identity.serial) == ("Fictional Instruments", "FT-3", "1001")
            assert identity.verified
            assert identity.fingerprint == "frames of 32 bytes with AA 55 at 0, 90 at 2, crc16"
        with pytest.raises(WrongIdentity, match="serial is '1001', the bench file says '1002'"):
            await framed.driver(IdentityPin(serial="1002")).__aenter__()

    async def stated(framed: Framed) -> None:
        async with framed.driver(IdentityPin(serial="A-7", maker="Somebody")) as driver:
            identity = await driver.identify()
            assert (identity.maker, identity.serial, identity.verified) == ("Somebody", "A-7", False)

    with_framed(told)
    with_framed(stated, PLAIN)


def test_another_controller_in_its_place_is_refused_whatever_is_asked() -> None:
    async def use(framed: Framed, driver: Any) -> None:
        framed.controller._serial_number = 1002
        with pytest.raises(WrongIdentity, match="another instrument has taken its place; received 1002"):
            await driver.rotate_at(10, acceleration_dps2=None)
        assert framed.sent("enable") == framed.sent("rate") == 0

    with_driver(use)


def test_the_profile_says_how_the_line_is_set_unless_the_address_does() -> None:
    async def use(framed: Framed) -> None:
        opened: list[str] = []
        stream = framed.wire.stream

        async def noted(device: str, address: Any, factory: Any) -> Any:
            opened.append(str(address))
            return await stream(device, address, factory)

        framed.wire.stream = noted  # type: ignore[method-assign] # a tap on a tap
        for address in ("serial:///dev/ttyS0", "serial:///dev/ttyS0?baud=57600", "tcp://127.0.0.1:9000"):
            async with framed.driver(address=address):
                pass
        assert opened == [
            "serial:/dev/ttyS0?baud=115200&bytesize=8&parity=N&stopbits=1".replace(":/", ":///"),
            "serial:///dev/ttyS0?baud=57600&bytesize=8&parity=N&stopbits=1",
            "tcp://127.0.0.1:9000",
        ]

    with_framed(use)


# Motions


@both
@pytest.mark.parametrize(
    ("start_deg", "approach", "goal_deg"),
    [(0, "direct", 270), (0, "from_below", 30), (0, "from_above", 30), (270, "direct", -30), (30, "from_below", 30)],
)
def test_it_goes_to_angles(profile: FrameProfile, start_deg: float, approach: Approach, goal_deg: float) -> None:
    async def use(framed: Framed, driver: Any) -> None:
        await driver.move_to(start_deg, approach="direct", settle_s=0)
        assert (await driver.move_to(goal_deg, approach=approach, settle_s=1)).value == pytest.approx(
            goal_deg, abs=1e-4
        )
        assert framed.angle_deg == pytest.approx(goal_deg, abs=1e-4)
        await driver.poll()

    with_driver(use, profile)


@both
@pytest.mark.parametrize("rate_dps", [90, -90, 0.02, 0])
def test_it_turns_at_the_rate_it_is_told_and_counts_turns(profile: FrameProfile, rate_dps: float) -> None:
    async def use(framed: Framed, driver: Any) -> None:
        await driver.rotate_at(1, acceleration_dps2=None)
        sent = framed.sent("stop")
        await driver.rotate_at(rate_dps, acceleration_dps2=100)
        assert framed.sent("stop") == sent  # from one rate to another it does not stop
        assert framed.rate_dps == pytest.approx(rate_dps, abs=0.05)
        for _ in range(6):
            await asyncio.sleep(3.3)
            assert (await driver.angle()).value == pytest.approx(framed.angle_deg, abs=0.5 + abs(rate_dps) * 0.1)
        await driver.poll()
        await driver.stop()
        assert (framed.rate_dps, framed.moving) == (0, False)

    with_driver(use, profile)


def test_it_swings_where_the_controller_can_and_says_where_it_cannot() -> None:
    async def swings(framed: Framed, driver: Any) -> None:
        await driver.move_to(40, approach="direct", settle_s=0)
        await driver.oscillate(10, 0.5)
        assert framed.sent("sine") == 1
        await driver.poll()
        await asyncio.sleep(1.7)
        assert framed.angle_deg == pytest.approx(40, abs=10)
        await driver.stop()

        await driver.oscillate(10, 0.5)
        with pytest.raises(Refused, match="the controller cannot sweep the frequency of a running sine"):
            await driver.sweep(1.0, 60.0)

    async def cannot(framed: Framed, driver: Any) -> None:
        with pytest.raises(Refused, match=r"the controller cannot oscillate: its profile has no commands\.sine"):
            await driver.oscillate(10, 0.5)
        assert not framed.moving

    with_driver(swings)
    with_driver(cannot, PLAIN)


def test_beyond_its_limits_nothing_is_sent() -> None:
    async def use(framed: Framed, driver: Any) -> None:
        sent = len(framed.wire.requests)
        for attempt in (driver.rotate_at(401, acceleration_dps2=None), driver.oscillate(100, 25)):
            with pytest.raises(BeyondLimit, match="Nothing was moved"):
                await attempt
        assert len(framed.wire.requests) == sent

    with_driver(use)


@pytest.mark.parametrize(
    ("motion", "problem"),
    [(MOVE, "the angle 100° is outside the -90° to 90° of the profile"),
     (ROTATE, "the rate 50 °/s is above the 40 °/s of the profile")],
)  # fmt: skip
def test_the_limits_of_the_profile_hold_as_well(motion: Motion, problem: str) -> None:
    limits = {"angle": {"min": "-90°", "max": "90°"}, "rate": {"max": "40 °/s"}}

    async def use(framed: Framed) -> None:
        async with framed.driver(rate="20 °/s") as driver:
            with pytest.raises(BeyondLimit, match=f"{problem}.*No motion was sent"):
                await motion(driver)
            assert not framed.moving

    with_framed(use, FICTIONAL.model_copy(update={"limits": ControllerLimits.model_validate(limits)}))


def test_what_no_frame_holds_is_refused_before_it_is_sent() -> None:
    async def use(framed: Framed, driver: Any) -> None:
        with pytest.raises(
            Refused,
            match=r"this rate does not fit its frame: 400 does not fit i16; nothing was sent",
        ):
            await driver.rotate_at(400, acceleration_dps2=None)
        assert framed.sent("rate") == 1  # the zero with which RATE begins

    with_driver(use, PLAIN)


# What is read back


@motions
def test_a_stuck_table_is_not_settled_in_time(motion: Motion) -> None:
    async def use(framed: Framed, driver: Any) -> None:
        framed.faults.begin("stuck")
        with pytest.raises(NotSettled):
            await motion(driver)
        assert 30 < now_s() < 45

    with_driver(use)


def test_a_controller_that_takes_another_target_than_it_was_told_is_refused() -> None:
    async def use(framed: Framed, driver: Any) -> None:
        await driver.rotate_at(1, acceleration_dps2=None)
        turn = framed.controller._handlers["rate"]

        def limited(frame: bytes) -> None:
            turn(frame)
            framed.controller.target_dps = min(framed.controller.target_dps, 30.0)

        framed.controller._handlers["rate"] = limited
        words = r"took another target rate than commanded; sent rate 50 \(500000\); received 30 \(300000\)"
        with pytest.raises(Refused, match=words):
            await driver.rotate_at(50, acceleration_dps2=None)

    with_driver(use)


@both
@pytest.mark.parametrize("name", ["move", "rate"])
def test_a_command_that_never_arrived_is_not_repeated(profile: FrameProfile, name: str) -> None:
    async def use(framed: Framed, driver: Any) -> None:
        motion = MOVE if name == "move" else ROTATE
        await motion(driver)
        sent = framed.sent(name)
        framed.wire.lose = framed.is_a(name)
        with pytest.raises(NotSettled):
            await (
                driver.move_to(10, approach="direct", settle_s=0)
                if name == "move"
                else driver.rotate_at(20, acceleration_dps2=None)
            )
        assert framed.sent(name) == sent + 1

    with_driver(use, profile)


def test_a_motor_that_stays_off_is_refused() -> None:
    async def use(framed: Framed, driver: Any) -> None:
        framed.wire.lose = framed.is_a("enable")
        with pytest.raises(Refused, match="the motor stays off; sent enable; received disabled, at rest, mode off"):
            await driver.rotate_at(50, acceleration_dps2=None)
        assert (framed.sent("enable"), framed.sent("rate")) == (1, 0)

    with_driver(use)


def later(framed: Framed, name: str) -> None:
    """From now on a command takes effect after 18 ms, within the `reaction` of the profile."""
    act, loop = framed.controller._handlers[name], asyncio.get_running_loop()
    framed.controller._handlers[name] = lambda frame: loop.call_later(0.018, act, frame)


def test_a_status_of_before_a_command_is_not_taken_for_one_after_it() -> None:
    async def use(framed: Framed, driver: Any) -> None:
        later(framed, "enable")
        await driver.rotate_at(50, acceleration_dps2=None)
        await driver.stop()
        later(framed, "rate")
        framed.wire.lose = framed.is_a("stop")
        await driver._axis.line.send_command("rate", [(FICTIONAL.number(FICTIONAL.commands.rate.rate), 500_000)])
        with pytest.raises(NoAnswer, match="is not proved safe"):
            await driver.make_safe()
        assert framed.moving

    with_driver(use)


def test_a_command_that_waits_for_its_turn_is_not_sent_when_the_table_is_made_safe() -> None:
    async def use(framed: Framed, driver: Any) -> None:
        line = driver._axis.line
        framed.faults.begin("silent")
        looking = asyncio.create_task(line.status())
        await asyncio.sleep(0.1)
        waiting = asyncio.create_task(line.send_command("enable"))
        await asyncio.sleep(0.1)
        framed.faults.end("silent")
        await driver.make_safe()
        with pytest.raises(Refused, match="not sent, the instrument is being made safe; sent enable aa 55 20 01"):
            await waiting
        with pytest.raises(Refused, match="aborted, the instrument"):
            await looking
        assert framed.sent("enable") == 0

    with_driver(use)


# Faults, and other hands


@motions
def test_a_latched_fault_is_named_and_never_cleared(motion: Motion) -> None:
    async def use(framed: Framed, driver: Any) -> None:
        await motion(driver)
        framed.controller.trip(1)
        words = "reports a fault: .*overspeed.*clear the fault at the controller"
        for attempt in (driver.poll, lambda: motion(driver), driver.stop):
            with pytest.raises(InstrumentFault, match=words):
                await attempt()
        await driver.make_safe()
        assert framed.sent("clear_fault") == framed.sent("home") == framed.sent("disable") == 0

    with_driver(use)


@motions
def test_an_emergency_stop_ends_a_motion(motion: Motion) -> None:
    async def use(framed: Framed, driver: Any) -> None:
        asyncio.get_running_loop().call_later(0.65, framed.controller.press_emergency_stop)
        with pytest.raises(InstrumentFault, match="emergency stop"):
            await motion(driver)
        assert now_s() < 0.65 + 0.5, "a far motion is looked at every half a second"
        await asyncio.sleep(1)
        assert not framed.moving

    with_driver(use)


@pytest.mark.parametrize(
    ("attribute", "value", "problem"),
    [("enabled", False, "was switched off"), ("mode", "off", "is in mode Off, commanded was Rate"),
     ("mode", "sine", "is in mode Synthesis, commanded was Rate"),
     ("remote", False, "another master has taken control")],
)  # fmt: skip
def test_what_others_do_to_it_is_a_fault_within_one_poll(attribute: str, value: Any, problem: str) -> None:
    async def use(framed: Framed, driver: Any) -> None:
        await ROTATE(driver)
        setattr(framed.controller, attribute, value)
        with pytest.raises(InstrumentFault, match=problem):
            await driver.poll()

    with_driver(use)


@both
def test_a_table_left_turning_by_others_is_stopped_before_it_is_used(profile: FrameProfile) -> None:
    async def use(framed: Framed) -> None:
        framed.controller.enabled = True
        framed.elsewhere("rate", rate=80)
        await asyncio.sleep(3)
        async with framed.driver() as driver:
            await driver.poll()
            assert (await driver.move_to(0, approach="direct", settle_s=0)).value == pytest.approx(0, abs=1e-4)
        assert framed.sent("stop") == 1

    with_framed(use, profile)


def test_another_rate_than_it_was_told_is_a_fault() -> None:
    async def use(framed: Framed, driver: Any) -> None:
        await ROTATE(driver)
        framed.elsewhere("rate", rate=60)
        await asyncio.sleep(2)
        with pytest.raises(InstrumentFault, match="does not turn at 50 °/s"):
            await driver.poll()

    with_driver(use, PLAIN)


def test_an_axis_that_was_not_homed_does_not_move() -> None:
    async def use(framed: Framed, driver: Any) -> None:
        with pytest.raises(InstrumentFault, match=r"has not been homed.*Home it at the controller"):
            await MOVE(driver)
        assert framed.sent("move") == framed.sent("home") == 0

    with_driver(use, homed=False)


def test_a_head_that_does_not_obey_the_line_is_a_fault() -> None:
    async def use(framed: Framed, driver: Any) -> None:
        await driver.move_to(10, approach="from_below", settle_s=0)
        framed.controller.remote = False
        with pytest.raises(InstrumentFault, match=r"does not obey this line.*Switch it to remote"):
            await driver.poll()

    with_driver(use, FICTIONAL, HEAD)


def test_a_profile_that_is_gone_is_told() -> None:
    async def use(framed: Framed) -> None:
        with pytest.raises(CannotConnect, match=r"the profile gone\.yaml of its controller is gone"):
            framed.driver(profile=DocumentFile(Path("gone.yaml"), None))

    with_framed(use)


# A line that loses, and one that is silent


@both
def test_the_same_status_again_and_again_is_a_silence(profile: FrameProfile) -> None:
    async def use(framed: Framed, driver: Any) -> None:
        await ROTATE(driver)
        framed.controller.stale = True
        await asyncio.sleep(1)
        start_s = now_s()
        with pytest.raises(NoAnswer, match=r"only repetitions of the same status for 0\.5 s"):
            await driver.poll()
        assert now_s() - start_s < 1.7  # it is looked at twice
        framed.controller.stale = False
        await driver.poll()

    with_driver(use, profile)


def test_statuses_that_do_not_come_are_counted_and_told_once_a_minute() -> None:
    async def use(framed: Framed, driver: Any) -> None:
        framed.controller.loses = 5
        for _ in range(130):
            await driver.poll()
            await asyncio.sleep(1)
        missing = [int(note.rpartition("; ")[2].split()[0]) for note in framed.notes]
        assert len(missing) in (2, 3)
        assert missing[1] - missing[0] == pytest.approx(60 / 0.05 / 5, rel=0.1)
        assert all("0 bytes belonged to no frame" in note for note in framed.notes)

    with_driver(use, PLAIN)


@both
def test_other_bytes_are_dropped_counted_and_told(profile: FrameProfile) -> None:
    async def use(framed: Framed, driver: Any) -> None:
        say = framed.wire.alter
        framed.wire.alter = lambda request, answer: b"\x01\x02\x03" + say(request, answer) if answer else answer
        await driver.poll()
        await driver.poll()
        assert len(framed.notes) == 1
        assert "bytes belonged to no frame, the last 01 02 03" in framed.notes[0]

    with_driver(use, profile)


@both
def test_bytes_that_make_no_frame_are_quoted(profile: FrameProfile) -> None:
    async def use(framed: Framed) -> None:
        framed.wire.alter = lambda _request, answer: b"\x01" * 9 if answer else answer
        with pytest.raises(
            NoAnswer, match=r"no status within 0\.5 s.*received \d+ bytes that belong to no frame, 01 01"
        ):
            await framed.driver().__aenter__()

    with_framed(use, profile)


def test_what_the_way_still_held_of_before_it_was_connected_is_not_looked_at() -> None:
    async def use(framed: Framed) -> None:
        old, stream = [framed.controller.status() for _ in range(4)], framed.wire.stream
        framed.elsewhere("rate", rate=80)
        await asyncio.sleep(3)

        async def held(device: str, address: Any, factory: Any) -> Any:
            client = await stream(device, address, factory)
            transport = framed.wire.connections[-1].transport
            assert transport is not None
            for number, frame in enumerate(old):
                asyncio.get_running_loop().call_later(0.003 * number, transport.write, frame)
            return client

        framed.wire.stream = held  # type: ignore[method-assign] # something that buffers on the way
        async with framed.driver() as driver:
            assert (await driver.rate()).value == 80
            framed.wire.drop()
            await asyncio.sleep(0.1)
            assert (await driver.rate()).value == 80

    with_framed(use, PLAIN)


@both
def test_silence_is_reported_in_time_and_it_is_found_again(profile: FrameProfile) -> None:
    async def use(framed: Framed, driver: Any) -> None:
        await ROTATE(driver)
        framed.faults.begin("silent")
        start_s = now_s()
        with pytest.raises(NoAnswer, match=r"no status within 0\.5 s"):
            await driver.poll()
        with pytest.raises(NoAnswer):
            await driver.make_safe()
        assert now_s() - start_s < 5.6
        framed.faults.end("silent")
        await asyncio.sleep(2)
        await driver.make_safe()
        assert not framed.moving
        assert any(note.startswith("connected and identified again") for note in framed.notes)

    with_driver(use, profile)


@both
def test_a_lost_connection_is_opened_again_and_a_command_does_not_open_it(profile: FrameProfile) -> None:
    async def use(framed: Framed, driver: Any) -> None:
        await ROTATE(driver)
        framed.wire.drop()
        await asyncio.sleep(0.1)
        await driver.poll()
        assert len(framed.wire.connections) == 2
        framed.wire.drop()
        await asyncio.sleep(0.1)
        await driver.make_safe()
        assert not framed.moving

    with_driver(use, profile)


def test_a_profile_that_says_request_of_a_controller_that_sends_by_itself_is_told() -> None:
    asked = FrameProfile.model_validate(
        {key: value for key, value in PLAIN_FILE.items() if key != "cyclic"}
        | {"request": {"length": 5, "constants": [{"at": 1, "bytes": "09"}]}}
    )

    async def use(framed: Framed) -> None:
        framed.profile = asked
        with pytest.raises(BadAnswer, match=r"is not silent within 5 s.*cyclic, not request"):
            await framed.driver(address="socket://127.0.0.1:4001").__aenter__()

    with_framed(use, PLAIN)


def test_after_failures_it_is_connected_again_with_growing_pauses() -> None:
    async def use(framed: Framed, driver: Any) -> None:
        framed.wire.drop()
        framed.wire.broken = True
        await asyncio.sleep(0.1)
        with pytest.raises(CannotConnect):
            await driver.poll()
        for pause_s in (1, 2, 4):
            with pytest.raises(LinkLost, match=rf"is not connected; the next attempt is in {pause_s}\.0 s"):
                await driver.poll()
            await asyncio.sleep(pause_s)
            with pytest.raises(CannotConnect):
                await driver.poll()
        framed.wire.broken = False
        await asyncio.sleep(8)
        await driver.poll()

    async def left(framed: Framed) -> None:
        async with framed.driver() as driver:
            pass
        with pytest.raises(LinkLost, match="is not connected"):
            await driver.poll()
        with pytest.raises(LinkLost, match="is not connected"):
            await framed.driver().poll()

    with_driver(use)
    with_framed(left)


def test_a_connection_that_is_lost_while_a_status_is_waited_for_is_told() -> None:
    async def use(framed: Framed, driver: Any) -> None:
        framed.faults.begin("silent")
        looking = asyncio.create_task(driver.poll())
        await asyncio.sleep(0.2)
        framed.wire.drop()
        with pytest.raises(LinkLost, match=r"the connection was closed .*; sent request aa 55 10"):
            await looking
        with pytest.raises(LinkLost, match=r"the connection was closed .*; sent stop aa 55 23"):
            await driver.stop()

    with_driver(use)


FLOATS = FrameProfile.model_validate(
    PLAIN_FILE | {"gap": "5 ms", "status": PLAIN_FILE["status"] | {"angle": {"at": 2, "type": "f32", "scale": "1°"}}}
)


def test_an_angle_that_is_no_number_is_an_error_and_frames_keep_their_distance() -> None:
    async def use(framed: Framed, driver: Any) -> None:
        line, heard_at_s = driver._axis.line, list[float]()
        framed.wire.lose = lambda _request: heard_at_s.append(now_s()) is not None
        await line.send_command("stop")
        await line.send_command("stop")
        assert heard_at_s[1] - heard_at_s[0] == pytest.approx(0.005)
        framed.controller._read = lambda: (float("nan"), 0.0)
        await asyncio.sleep(0.1)
        with pytest.raises(BadAnswer, match=r"a status with an invalid number: nan at 2; received fa"):
            await driver.poll()

    with_driver(use, FLOATS)


# Where commands are answered

ANSWERED = FICTIONAL.model_copy(update={"commands_answered": True})


@motions
def test_a_controller_that_answers_commands(motion: Motion) -> None:
    async def use(framed: Framed, driver: Any) -> None:
        await motion(driver)
        await driver.stop()
        await driver.make_safe()
        assert not framed.moving

    with_driver(use, ANSWERED)


@pytest.mark.parametrize("answer", [b"", b"\xaa\x55\x90"], ids=["none", "cut"])
def test_a_command_whose_answer_is_lost_is_sent_once_and_decided_by_what_is_read_back(answer: bytes) -> None:
    async def use(framed: Framed, driver: Any) -> None:
        is_turn = framed.is_a("rate")
        framed.wire.alter = lambda request, good: answer if is_turn(request) else good
        await ROTATE(driver)
        assert framed.rate_dps == 50
        assert framed.sent("rate") == 2

    with_driver(use, ANSWERED)


# The safe state


@both
def test_making_safe_stops_at_once_while_a_status_is_waited_for(profile: FrameProfile) -> None:
    async def use(framed: Framed, driver: Any) -> None:
        await ROTATE(driver)
        framed.faults.begin("silent")
        looking = asyncio.create_task(driver.poll())
        await asyncio.sleep(0.2)
        framed.faults.end("silent")
        start_s = now_s()
        await driver.make_safe()
        assert now_s() - start_s < 2
        assert not framed.moving
        with pytest.raises(Refused, match="aborted, the instrument"):
            await looking

    with_driver(use, profile)


def test_a_table_that_does_not_stop_is_not_proved_safe() -> None:
    async def use(framed: Framed, driver: Any) -> None:
        await ROTATE(driver)
        framed.wire.lose = framed.is_a("stop")
        start_s = now_s()
        with pytest.raises(NoAnswer, match="is not proved safe within 7 s"):
            await driver.make_safe()
        assert now_s() - start_s == pytest.approx(7)
        with pytest.raises(NotSettled, match="still turns after a stop"):
            await driver.stop()

    with_driver(use)


def test_a_fault_that_leaves_the_motor_on_proves_no_rest() -> None:
    async def use(framed: Framed, driver: Any) -> None:
        await ROTATE(driver)
        framed.controller._latched.add(1)
        framed.wire.lose = framed.is_a("stop")
        with pytest.raises(NoAnswer, match="is not proved safe within 7 s"):
            await driver.make_safe()

    with_driver(use)


@both
def test_a_motion_is_over_whenever_it_is_made_safe(profile: FrameProfile) -> None:
    for after_s in (0.0, 0.001, 0.02, 0.03, 0.05, 0.3, 0.53, 0.57, 0.6, 0.65, 0.8, 0.9):

        async def use(framed: Framed, driver: Any, after_s: float = after_s) -> None:
            motion = asyncio.create_task(driver.rotate_at(90, acceleration_dps2=None))
            await asyncio.sleep(after_s)
            await driver.make_safe()
            assert not framed.moving
            turns = framed.sent("rate")
            with pytest.raises(Refused):
                await motion
            await asyncio.sleep(5)
            assert (framed.moving, framed.sent("rate")) == (False, turns)

        with_driver(use, profile)
