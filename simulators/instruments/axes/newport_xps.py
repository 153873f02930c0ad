"""An indexing head on an XPS controller: one group with one positioner, its states and errors, and the TCP port."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Self

from drivers.dialects.newport_xps import wire
from drivers.dialects.newport_xps.wire import GroupState, Profile, Reply
from simulators.faults.instrument_faults import MEASUREMENT_AND_COMMAND_FAULTS, FaultEffect, FaultKind, FaultPlan
from simulators.instruments.setup import InstrumentSetup
from simulators.serving.serve import DelayedAnswers
from simulators.world import World

FIRMWARE = "XPS-C8 Firmware V2.6.1"
FACTORY_LOGIN = ["Administrator", "Administrator"]
HOMING_RATE_DPS = 10.0
FOLLOWING_ERROR_BIT = 0x2
_NOT_INITIALISED, _KILLED, _ABORTED, _HOMED, _ARRIVED, _ENABLED = 0, 7, 10, 11, 12, 13
_DISABLED, _FOLLOWING_ERROR, _NOT_HOMED, _HOMING, _MOVING = 20, 22, 42, 43, 44
_ANSWERED_LATER = ("GroupMoveAbsolute", "GroupMoveRelative", "GroupHomeSearch")
_STATUS_WORDS = {
    _NOT_INITIALISED: "Not initialized state",
    _KILLED: "Not initialized state due to a GroupKill or KillAll command",
    _ABORTED: "Ready state due to an AbortMove command",
    _HOMED: "Ready state from homing",
    _ARRIVED: "Ready state from motion",
    _ENABLED: "Ready State due to a MotionEnable command",
    _DISABLED: "Disabled state",
    _FOLLOWING_ERROR: "Disabled state due to a following error during motion",
    _NOT_HOMED: "Not referenced state",
    _HOMING: "Homing state",
    _MOVING: "Moving state",
}
_CODE_WORDS = {
    wire.BUSY: "Busy socket: previous command not yet finished",
    wire.UNKNOWN_COMMAND: "Unknown command",
    wire.POSITIONER_ERROR: "Not allowed due to a positioner error or hardware status",
    wire.WRONG_FORMAT: "Wrong format in the command string",
    wire.PARAMETER_OUT_OF_RANGE: "Parameter out of range or incorrect",
    wire.POSITIONER_NAME: "Positioner Name doesn't exist or unknown command",
    wire.GROUP_NAME: "GroupName doesn't exist or unknown command",
    wire.NOT_ALLOWED: "Not allowed action",
    wire.FOLLOWING_ERROR: "Following Error",
    wire.EMERGENCY: "Emergency signal",
    wire.ABORTED: "Move Aborted",
    wire.TRAVEL_LIMITS: "Position is outside of travel limits",
    wire.WRONG_PASSWORD: "Wrong Username or password",
}


class CallRefusedError(Exception):
    """A call answered with an error number."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class SimulatedXps:
    """A controller with one axis, the head of the world or that of a `role`.

    Errors stay until PositionerErrorGet reads them. `frozen`: the encoder angle does not change. `stuck`: a move is
    answered and does not begin.
    """

    def __init__(
        self, world: World, faults: FaultPlan, *, group: str = "HEAD", positioner: str = "Pos", homed: bool = True,
        travel_deg: tuple[float, float] = (-370.0, 370.0), fastest: tuple[float, float] = (80.0, 320.0),
        role: str | None = None,
    ) -> None:  # fmt: skip
        self.faults, self.firmware = faults, FIRMWARE
        self.profile = Profile(10.0, 40.0, 0.04, 0.04)
        self._world, self._role, self._driven = world, role, world.axis_of(role)
        self._group, self._positioner = group, f"{group}.{positioner}"
        self._travel_deg, self._fastest = travel_deg, fastest
        self._status = _HOMED if homed else _NOT_INITIALISED
        self._error = 0
        self._angle_deg = self._driven.encoder_deg(world.now())
        self._waiting: XpsSession | None = None  # for the end of the current motion
        self._functions: dict[str, Callable[[Sequence[str]], str]] = {
            "FirmwareVersionGet": lambda _: self.firmware,
            "Login": self._login,
            "ErrorListGet": lambda _: ";".join(f"Error {code}: {words}" for code, words in _CODE_WORDS.items()) + ";",
            "ErrorStringGet": lambda given: f"Error {given[0]} : {_CODE_WORDS.get(int(given[0]), '')}",
            "KillAll": lambda _: self._kill([self._group]),
            **dict.fromkeys(("GroupInitialize", "GroupInitializeNoEncoderReset"), self._initialise),
            "GroupHomeSearch": self._home,
            "GroupMotionEnable": self._enable,
            "GroupMotionDisable": self._disable,
            "GroupKill": self._kill,
            "GroupMoveAbsolute": self._move,
            "GroupMoveRelative": self._move_by,
            "GroupMoveAbort": self._abort,
            **dict.fromkeys(("GroupPositionCurrentGet", "GroupPositionSetpointGet"), self._position),
            "GroupPositionTargetGet": lambda given: self._of_axis(given, [self._driven.target_deg()]),
            "GroupVelocityCurrentGet": lambda given: self._of_axis(given, [self._driven.rate_dps(self._world.now())]),
            "GroupMotionStatusGet": lambda given: self._of_axis(given, [self._driven.moving(self._world.now())]),
            "GroupStatusGet": lambda given: str(self._of_group(given)),
            "GroupStatusStringGet": lambda given: _STATUS_WORDS.get(int(given[0]), ""),
            "PositionerErrorRead": self._read_error,
            "PositionerErrorGet": self._take_error,
            "PositionerErrorStringGet": lambda given: "Fatal following error" if int(given[0]) else "",
            "PositionerSGammaParametersGet": lambda given: self._of_positioner(given, self.profile),
            "PositionerSGammaParametersSet": self._set_profile,
            "PositionerUserTravelLimitsGet": lambda given: self._of_positioner(given, self._travel_deg),
            "PositionerMaximumVelocityAndAccelerationGet": lambda given: self._of_positioner(given, self._fastest),
        }

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """Create from a bench file."""
        options = setup.options
        return cls(setup.world, setup.faults, group=options.group, positioner=options.positioner, role=setup.axis)

    def session(self) -> XpsSession:
        """Open a connection."""
        return XpsSession(self)

    @property
    def status(self) -> int:
        """Number of the group status."""
        if self._status in (_HOMING, _MOVING) and not self._driven.moving(self._world.now()):
            self._status = _HOMED if self._status == _HOMING else _ARRIVED
        return self._status

    def trip(self) -> None:
        """Following error: the axis stops and is disabled, and its move is answered with the error."""
        self._error |= FOLLOWING_ERROR_BIT
        self._end_motion(_FOLLOWING_ERROR, wire.FOLLOWING_ERROR)

    def stop_at_once(self) -> None:
        """Emergency stop: the group is killed, as by GroupKill."""
        self._end_motion(_KILLED, wire.EMERGENCY)

    def execute(self, text: str, session: XpsSession) -> Reply | None:
        """Execute a call; None for one that is answered at the end of its motion."""
        try:
            call = wire.parse_call(text)
            answer = self._functions[call.name](call.arguments)
        except KeyError:
            return Reply(wire.UNKNOWN_COMMAND, text)
        except (IndexError, ValueError):
            return Reply(wire.WRONG_FORMAT, text)
        except CallRefusedError as refused:
            return Reply(refused.code, text)
        if call.name in _ANSWERED_LATER and self._driven.moving(self._world.now()):
            self._waiting = session
            session.answer_in(self._driven.left_s(self._world.now()), text)
            return None
        return Reply(wire.SUCCESS, answer)

    def _end_motion(self, status: int, code: int) -> None:
        self._world.stop(self._role)
        self._status = status
        if self._waiting is not None:
            self._waiting.end(code)
            self._waiting = None

    def _of_group(self, given: Sequence[str]) -> int:
        if given[0] != self._group:
            raise CallRefusedError(wire.GROUP_NAME)
        return self.status

    def _of_positioner(self, given: Sequence[str], values: Sequence[float] = ()) -> str:
        if given[0] != self._positioner:
            raise CallRefusedError(wire.POSITIONER_NAME)
        return ",".join(f"{value:.12g}" for value in values)

    def _of_axis(self, given: Sequence[str], values: Sequence[float] = ()) -> str:
        """Return whether a name is the group, which consists of this one axis, or its positioner; both are accepted."""
        return self._of_positioner([self._positioner] if given[0] == self._group else given, values)

    def _from(self, given: Sequence[str], *states: GroupState) -> None:
        if wire.group_state(self._of_group(given)) not in states:
            raise CallRefusedError(wire.NOT_ALLOWED)

    def _login(self, given: Sequence[str]) -> str:
        if list(given) != FACTORY_LOGIN:
            raise CallRefusedError(wire.WRONG_PASSWORD)
        return ""

    def _initialise(self, given: Sequence[str]) -> str:
        self._from(given, GroupState.NOT_INITIALISED)
        self._status, self._error = _NOT_HOMED, 0
        return ""

    def _home(self, given: Sequence[str]) -> str:
        self._from(given, GroupState.NOT_HOMED)
        self._status = _HOMING
        self._world.move(0.0, HOMING_RATE_DPS, role=self._role)
        return ""

    def _enable(self, given: Sequence[str]) -> str:
        self._from(given, GroupState.SWITCHED_OFF, GroupState.TRIPPED)
        if self._error:
            raise CallRefusedError(wire.POSITIONER_ERROR)
        self.faults.do(self._put_on)
        return ""

    def _put_on(self) -> None:
        self._status = _ENABLED

    def _disable(self, given: Sequence[str]) -> str:
        self._from(given, GroupState.READY)
        self._status = _DISABLED
        return ""

    def _kill(self, given: Sequence[str]) -> str:
        self._of_group(given)
        self.stop_at_once()
        return ""

    def _move_by(self, given: Sequence[str]) -> str:
        return self._move([given[0], str(self._driven.target_deg() + float(given[1]))])

    def _move(self, given: Sequence[str]) -> str:
        self._of_axis(given)
        self._from([self._group], GroupState.READY)
        angle_deg = float(given[1])
        if not self._travel_deg[0] <= angle_deg <= self._travel_deg[1]:
            raise CallRefusedError(wire.PARAMETER_OUT_OF_RANGE)
        if not self.faults.active("stuck"):
            self._status = _MOVING
            self._world.move(angle_deg, self.profile.rate_dps, self.profile.acceleration_dps2, role=self._role)
        return ""

    def _abort(self, given: Sequence[str]) -> str:
        self._from(given, GroupState.MOVING)
        self._end_motion(_ABORTED, wire.ABORTED)
        return ""

    def _position(self, given: Sequence[str]) -> str:
        if not self.faults.active("frozen"):
            self._angle_deg = self._driven.encoder_deg(self._world.now())
        return self._of_axis(given, [self._angle_deg])

    def _read_error(self, given: Sequence[str]) -> str:
        self._of_positioner(given)
        return str(self._error)

    def _take_error(self, given: Sequence[str]) -> str:
        text = self._read_error(given)
        self._error = 0
        return text

    def _set_profile(self, given: Sequence[str]) -> str:
        self._of_positioner(given)
        profile = Profile(*map(float, given[1:5]))
        if not (0 < profile.rate_dps <= self._fastest[0] and 0 < profile.acceleration_dps2 <= self._fastest[1]):
            raise CallRefusedError(wire.PARAMETER_OUT_OF_RANGE)
        self.faults.do(lambda: self._put_profile(profile))
        return ""

    def _put_profile(self, profile: Profile) -> None:
        self.profile = profile

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **MEASUREMENT_AND_COMMAND_FAULTS,
        "emergency_stop": FaultEffect(stop_at_once),
        "tripped": FaultEffect(trip),
    }


class XpsSession(DelayedAnswers):
    """One connection: a call ends with its parenthesis; during one call, the next is refused."""

    def __init__(self, controller: SimulatedXps) -> None:
        self._controller = controller
        self._rest = b""
        self._under_way = ""
        self._motions = 0

    def feed(self, data: bytes) -> bytes:
        """Receive bytes in any portions; return the immediate answers."""
        *calls, self._rest = (self._rest + data).split(b")")
        replies = [self._execute(f"{call.decode('latin-1')})") for call in calls]
        return b"".join(wire.render(reply) for reply in replies if reply is not None)

    def answer_in(self, delay_s: float, text: str) -> None:
        """Answer the call `text` at the end of its motion."""
        self._under_way = text
        self._motions += 1
        motion = self._motions
        self._later(delay_s, lambda: self._finish(motion, wire.SUCCESS))

    def end(self, code: int) -> None:
        """End the motion early, with this error number."""
        motion = self._motions
        self._later(0.0, lambda: self._finish(motion, code))

    def _execute(self, text: str) -> Reply | None:
        if self._under_way:
            return Reply(wire.BUSY, text)
        return self._controller.execute(text, self)

    def _finish(self, motion: int, code: int) -> bytes:
        if motion != self._motions or not self._under_way:
            return b""
        text, self._under_way = self._under_way, ""
        return wire.render(Reply(code, "" if code == wire.SUCCESS else text))
