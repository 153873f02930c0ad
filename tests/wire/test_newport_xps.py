"""XPS calls and answers typed by hand, in both directions, and the simulated controller that speaks them."""

import pytest

from drivers.dialects.newport_xps import wire
from drivers.dialects.newport_xps.wire import Call, GroupState, Profile, Reply
from drivers.protocols import scpi
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.axes.newport_xps import SimulatedXps
from simulators.units.settings import WorldSettings
from simulators.world import World


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def head(clock: Clock) -> SimulatedXps:
    return SimulatedXps(World(WorldSettings(seed=1, gravity_mps2=9.8), clock), FaultPlan(now_s=clock))


def talk(head: SimulatedXps, *calls: bytes) -> list[bytes]:
    return [head.session().feed(call) for call in calls]


# The driver's side


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (wire.move_absolute("HEAD.Pos", 90.0), "GroupMoveAbsolute(HEAD.Pos,90.0)"),
        (wire.move_absolute("HEAD.Pos", -0.000278), "GroupMoveAbsolute(HEAD.Pos,-0.000278)"),
        (wire.move_absolute("HEAD.Pos", -1e-9), "GroupMoveAbsolute(HEAD.Pos,0.0)"),
        (wire.ABORT.format("HEAD"), "GroupMoveAbort(HEAD)"),
        (wire.ENABLE.format("HEAD"), "GroupMotionEnable(HEAD)"),
        (wire.ANGLE_QUERY.format("HEAD.Pos"), "GroupPositionCurrentGet(HEAD.Pos,double *)"),
        (wire.STATUS_QUERY.format("HEAD"), "GroupStatusGet(HEAD,int *)"),
        (wire.STATUS_TEXT_QUERY.format(12), "GroupStatusStringGet(12,char *)"),
        (wire.ERROR_QUERY.format("HEAD.Pos"), "PositionerErrorRead(HEAD.Pos,int *)"),
        (wire.ERROR_TEXT_QUERY.format(2), "PositionerErrorStringGet(2,char *)"),
        (wire.CODE_TEXT_QUERY.format(-22), "ErrorStringGet(-22,char *)"),
        (
            wire.PROFILE_QUERY.format("HEAD.Pos"),
            "PositionerSGammaParametersGet(HEAD.Pos,double *,double *,double *,double *)",
        ),
        (
            wire.set_profile("HEAD.Pos", Profile(20.0, 40.0, 0.005, 0.05)),
            "PositionerSGammaParametersSet(HEAD.Pos,20.0,40.0,0.005,0.05)",
        ),
        (wire.TRAVEL_QUERY.format("HEAD.Pos"), "PositionerUserTravelLimitsGet(HEAD.Pos,double *,double *)"),
        (
            wire.MAX_MOTION_QUERY.format("HEAD.Pos"),
            "PositionerMaximumVelocityAndAccelerationGet(HEAD.Pos,double *,double *)",
        ),
    ],
)
def test_calls_are_spelled_as_documented(call: str, text: str) -> None:
    assert call == text


@pytest.mark.parametrize(
    ("answer", "reply"),
    [
        (b"0,", Reply(0, "")),
        (b"0,0.000314605934", Reply(0, "0.000314605934")),
        (b"0,-370,370", Reply(0, "-370,370")),
        (b"-20,GroupPositionCurrentGet(Group1,double *)", Reply(-20, "GroupPositionCurrentGet(Group1,double *)")),
    ],
)
def test_an_answer_is_a_number_and_what_was_asked_for(answer: bytes, reply: Reply) -> None:
    assert wire.read_reply(answer) == reply
    assert wire.render(reply) == answer + b",EndOfAPI"


@pytest.mark.parametrize("answer", [b"", b"0", b",0", b"ok,", b"0.5,1", b" 0,1"])
def test_other_answers_are_none(answer: bytes) -> None:
    with pytest.raises(ValueError, match="no error number"):
        wire.read_reply(answer)


@pytest.mark.parametrize(
    ("text", "numbers"), [("0.000314605934", (0.000314605934,)), ("-370,3.7e+02", (-370.0, 370.0))]
)
def test_numbers(text: str, numbers: tuple[float, ...]) -> None:
    assert wire.read_numbers(text, len(numbers)) == numbers


@pytest.mark.parametrize("text", ["", "1", "1,2,3", "1,nan", "1, 2", "1,0x2", "1,1_0"])
def test_what_is_not_two_numbers_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="is not 2 numbers"):
        wire.read_numbers(text, 2)


@pytest.mark.parametrize("text", ["", "1.0", "12,", "0x2"])
def test_what_is_no_whole_number_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="not a whole number"):
        scpi.integer(text)


@pytest.mark.parametrize(
    ("firmware", "model"), [("XPS-C8 Firmware V2.6.x Beta 19", "XPS-C8"), ("HXP-D Firmware", "HXP-D")]
)
def test_the_model_is_in_the_version_of_the_firmware(firmware: str, model: str) -> None:
    assert wire.read_model(firmware) == model


def test_what_is_no_xps_has_no_model() -> None:
    with pytest.raises(ValueError, match="not the firmware of an XPS"):
        wire.read_model("ESP300 Version 3.08")


@pytest.mark.parametrize(
    ("status", "state"),
    [
        (0, GroupState.NOT_INITIALISED),
        (9, GroupState.NOT_INITIALISED),
        (50, GroupState.NOT_INITIALISED),
        (10, GroupState.READY),
        (12, GroupState.READY),
        (77, GroupState.READY),
        (20, GroupState.SWITCHED_OFF),
        (22, GroupState.TRIPPED),
        (84, GroupState.TRIPPED),
        (40, GroupState.MOVING),
        (42, GroupState.NOT_HOMED),
        (43, GroupState.MOVING),
        (44, GroupState.MOVING),
        (51, GroupState.MOVING),
        (68, GroupState.OTHER),
        (-1, GroupState.OTHER),
    ],
)
def test_the_numbers_of_a_groups_status(status: int, state: GroupState) -> None:
    assert wire.group_state(status) is state


# The simulator's side


@pytest.mark.parametrize(
    ("text", "call"),
    [
        ("GroupStatusGet(HEAD,int *)", Call("GroupStatusGet", ("HEAD",))),
        ("FirmwareVersionGet(char *)", Call("FirmwareVersionGet", ())),
        ("ErrorStringGet(-22, char *)", Call("ErrorStringGet", ("-22",))),
        ("\r\nGroupMoveAbsolute (HEAD.Pos, 90.0)", Call("GroupMoveAbsolute", ("HEAD.Pos", "90.0"))),
    ],
)
def test_a_call_is_taken_apart(text: str, call: Call) -> None:
    assert wire.parse_call(text) == call


def test_a_session_with_a_controller(head: SimulatedXps, clock: Clock) -> None:
    assert talk(head, b"FirmwareVersionGet(char *)", b"GroupStatusGet(HEAD,int *)") == [
        b"0,XPS-C8 Firmware V2.6.1,EndOfAPI", b"0,11,EndOfAPI",
    ]  # fmt: skip
    assert talk(
        head, b"PositionerSGammaParametersGet(HEAD.Pos,double *,double *,double *,double *)",
        b"GroupMoveAbsolute(HEAD.Pos,20.0)", b"GroupStatusGet(HEAD,int *)", b"GroupMoveAbsolute(HEAD.Pos,5)",
    ) == [
        b"0,10,40,0.04,0.04,EndOfAPI", b"", b"0,44,EndOfAPI", b"-22,GroupMoveAbsolute(HEAD.Pos,5),EndOfAPI",
    ]  # fmt: skip
    clock.now_s = 0.125 + 1.0
    assert talk(head, b"GroupPositionCurrentGet(HEAD.Pos,double *)") == [b"0,10,EndOfAPI"]
    clock.now_s = 2.25
    assert talk(head, b"GroupPositionCurrentGet(HEAD.Pos,double *)", b"GroupStatusGet(HEAD,int *)") == [
        b"0,20,EndOfAPI", b"0,12,EndOfAPI",
    ]  # fmt: skip
    assert talk(head, b"GroupStatusStringGet(12,char *)", b"GroupMoveAbort(HEAD)") == [
        b"0,Ready state from motion,EndOfAPI", b"-22,GroupMoveAbort(HEAD),EndOfAPI",
    ]  # fmt: skip


def test_calls_may_come_in_any_portions(head: SimulatedXps) -> None:
    session = head.session()
    answers = [session.feed(bytes([byte])) for byte in b"GroupStatusGet(HEAD,int *)Login(Administrator,x)"]
    assert b"".join(answers) == b"0,11,EndOfAPI-106,Login(Administrator,x),EndOfAPI"


def test_a_connection_on_which_a_move_is_under_way_is_busy(head: SimulatedXps) -> None:
    session = head.session()
    assert session.feed(b"GroupMoveAbsolute(HEAD.Pos,20.0)GroupMoveAbort(HEAD)") == b"-1,GroupMoveAbort(HEAD),EndOfAPI"
    assert talk(head, b"GroupMoveAbort(HEAD)", b"GroupStatusGet(HEAD,int *)") == [b"0,,EndOfAPI", b"0,10,EndOfAPI"]


@pytest.mark.parametrize(
    ("call", "code"),
    [
        (b"Fly(HEAD)", b"-4"),
        (b"GroupStatusGet)", b"-7"),
        (b"GroupStatusGet(int *)", b"-7"),
        (b"GroupMoveAbsolute(HEAD.Pos,far)", b"-7"),
        (b"GroupMoveAbsolute(HEAD.Pos,371.0)", b"-17"),
        (b"PositionerSGammaParametersSet(HEAD.Pos,81,40,0.04,0.04)", b"-17"),
        (b"GroupPositionCurrentGet(HEAD.Neg,double *)", b"-18"),
        (b"GroupStatusGet(TABLE,int *)", b"-19"),
        (b"GroupInitialize(HEAD)", b"-22"),
        (b"Login(Administrator,secret)", b"-106"),
    ],
)
def test_what_a_controller_refuses(head: SimulatedXps, call: bytes, code: bytes) -> None:
    assert talk(head, call) == [code + b"," + call + b",EndOfAPI"]


def test_initialising_homing_killing(head: SimulatedXps, clock: Clock) -> None:
    talk(head, b"GroupMoveAbsolute(HEAD.Pos,20.0)")
    clock.now_s = 1.0
    assert talk(
        head, b"GroupKill(HEAD)", b"GroupStatusGet(HEAD,int *)", b"GroupHomeSearch(HEAD)", b"GroupInitialize(HEAD)",
        b"GroupStatusGet(HEAD,int *)", b"GroupHomeSearch(HEAD)", b"GroupStatusGet(HEAD,int *)",
    ) == [
        b"0,,EndOfAPI", b"0,7,EndOfAPI", b"-22,GroupHomeSearch(HEAD),EndOfAPI", b"0,,EndOfAPI", b"0,42,EndOfAPI", b"",
        b"0,43,EndOfAPI",
    ]  # fmt: skip
    clock.now_s = 10.0
    assert talk(head, b"GroupStatusGet(HEAD,int *)", b"GroupMotionDisable(HEAD)", b"GroupStatusGet(HEAD,int *)") == [
        b"0,11,EndOfAPI", b"0,,EndOfAPI", b"0,20,EndOfAPI",
    ]  # fmt: skip


def test_an_error_stays_until_it_is_taken(head: SimulatedXps) -> None:
    head.trip()
    assert talk(
        head, b"GroupMotionEnable(HEAD)", b"PositionerErrorRead(HEAD.Pos,int *)", b"PositionerErrorGet(HEAD.Pos,int *)",
        b"PositionerErrorRead(HEAD.Pos,int *)", b"GroupMotionEnable(HEAD)", b"GroupStatusGet(HEAD,int *)",
    ) == [
        b"-5,GroupMotionEnable(HEAD),EndOfAPI", b"0,2,EndOfAPI", b"0,2,EndOfAPI", b"0,0,EndOfAPI", b"0,,EndOfAPI",
        b"0,13,EndOfAPI",
    ]  # fmt: skip


def test_a_frozen_encoder_and_a_stuck_axis(head: SimulatedXps, clock: Clock) -> None:
    head.faults.begin("frozen")
    talk(head, b"GroupMoveAbsolute(HEAD.Pos,20.0)")
    clock.now_s = 60.0
    assert talk(head, b"GroupPositionCurrentGet(HEAD.Pos,double *)") == [b"0,0,EndOfAPI"]
    head.faults.begin("stuck")
    assert talk(head, b"GroupMoveAbsolute(HEAD.Pos,0)", b"GroupStatusGet(HEAD,int *)") == [
        b"0,,EndOfAPI", b"0,12,EndOfAPI",
    ]  # fmt: skip


def test_a_group_of_one_axis_is_asked_and_moved_by_its_own_name_too(head: SimulatedXps, clock: Clock) -> None:
    # As ESRF's BLISS does for groups, and newportxps in get_group_position and move_group.
    assert talk(head, b"GroupMoveAbsolute(HEAD,20.0)") == [b""]
    clock.now_s = 1.0
    assert talk(
        head, b"GroupMotionStatusGet(HEAD,int *)", b"GroupVelocityCurrentGet(HEAD,double *)",
        b"GroupPositionTargetGet(HEAD,double *)",
    ) == [b"0,1,EndOfAPI", b"0,10,EndOfAPI", b"0,20,EndOfAPI"]  # fmt: skip
    clock.now_s = 10.0
    assert talk(head, b"GroupPositionCurrentGet(HEAD,double *)", b"GroupMoveRelative(HEAD.Pos,-5)") == [
        b"0,20,EndOfAPI", b"",
    ]  # fmt: skip
    clock.now_s = 20.0
    assert talk(head, b"GroupPositionCurrentGet(HEAD.Pos,double *)", b"GroupMotionStatusGet(HEAD,int *)") == [
        b"0,15,EndOfAPI", b"0,0,EndOfAPI",
    ]  # fmt: skip
    assert talk(head, b"KillAll()", b"GroupStatusGet(HEAD,int *)", b"GroupInitializeNoEncoderReset(HEAD)") == [
        b"0,,EndOfAPI", b"0,7,EndOfAPI", b"0,,EndOfAPI",
    ]  # fmt: skip
