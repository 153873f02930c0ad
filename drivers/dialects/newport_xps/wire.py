"""Newport XPS calls and answers in both directions, without the end of an answer.

A call is written as a C function, ended by its parenthesis; output arguments are written as types. The answer is an
error number (0 for success), the output values, and `EndOfAPI`; after an error the call is quoted instead. Source: the
common behaviour of third-party drivers (the package newportxps, ESRF's BLISS, JPL's golaborate), not a manual of the
maker.
"""

from __future__ import annotations

import math
import re
from enum import Enum
from typing import NamedTuple

from drivers.protocols.texts import decimal, matched

END = b",EndOfAPI"
SUCCESS = 0
BUSY = -1  # the previous call on this connection is not answered yet
UNKNOWN_COMMAND = -4
POSITIONER_ERROR = -5
WRONG_FORMAT = -7
PARAMETER_OUT_OF_RANGE = -17
POSITIONER_NAME = -18
GROUP_NAME = -19
NOT_ALLOWED = -22  # not allowed in this state of the group; for an abort: nothing moves
FOLLOWING_ERROR = -25
EMERGENCY = -26
ABORTED = -27
TRAVEL_LIMITS = -35
WRONG_PASSWORD = -106


class Reply(NamedTuple):
    """An answer: error number, and output values or the quoted call."""

    code: int
    text: str

    def __str__(self) -> str:
        return f"{self.code},{self.text}"


class GroupState(Enum):
    """Meaning of the numbers of a group status."""

    NOT_INITIALISED = "not initialised"
    NOT_HOMED = "not referenced"
    READY = "ready"
    MOVING = "moving"
    SWITCHED_OFF = "disabled by a command"
    TRIPPED = "disabled by a fault"
    OTHER = "in another state"


_STATES = {
    GroupState.NOT_INITIALISED: {*range(10), 50, 52, 60, 61, 63, 66, 67, 71, 72, 83, 106},
    GroupState.NOT_HOMED: {42},
    GroupState.READY: {*range(10, 20), 56, 70, 77, 79},
    GroupState.MOVING: {40, *range(43, 50), 51, 64},
    GroupState.SWITCHED_OFF: {20},
    GroupState.TRIPPED: {*range(21, 40), 58, 59, *range(74, 77), *range(80, 83), *range(84, 104)},
}


def group_state(status: int) -> GroupState:
    """Classify a number of GroupStatusGet; emergency braking, homing, jogging and spinning count as moving."""
    return next((state for state, numbers in _STATES.items() if status in numbers), GroupState.OTHER)


class Profile(NamedTuple):
    """Motion settings of a positioner: °/s, °/s², and minimum and maximum jerk time, s."""

    rate_dps: float
    acceleration_dps2: float
    min_jerk_s: float
    max_jerk_s: float


# Calls of the driver, to be completed by a group, a positioner or a number

FIRMWARE_QUERY = "FirmwareVersionGet(char *)"
ABORT = "GroupMoveAbort({})"  # decelerate and hold; the call of the move is then answered with ABORTED
ENABLE = "GroupMotionEnable({})"  # the servo of a group disabled by a command
STATUS_QUERY = "GroupStatusGet({},int *)"
STATUS_TEXT_QUERY = "GroupStatusStringGet({},char *)"
ANGLE_QUERY = "GroupPositionCurrentGet({},double *)"  # of the encoder, °
ERROR_QUERY = "PositionerErrorRead({},int *)"  # without clearing it, as PositionerErrorGet would
ERROR_TEXT_QUERY = "PositionerErrorStringGet({},char *)"
CODE_TEXT_QUERY = "ErrorStringGet({},char *)"  # of an error number
PROFILE_QUERY = "PositionerSGammaParametersGet({},double *,double *,double *,double *)"
TRAVEL_QUERY = "PositionerUserTravelLimitsGet({},double *,double *)"  # minimum and maximum target, °
MAX_MOTION_QUERY = "PositionerMaximumVelocityAndAccelerationGet({},double *,double *)"  # °/s, °/s²


def move_absolute(positioner: str, angle_deg: float) -> str:
    """Call: move to an angle; answered at the end of the move."""
    return f"GroupMoveAbsolute({positioner},{decimal(angle_deg)})"


def set_profile(positioner: str, profile: Profile) -> str:
    """Call: set the motion settings of the next moves."""
    return f"PositionerSGammaParametersSet({positioner},{','.join(decimal(value) for value in profile)})"


_REPLY = re.compile(r"(-?\d{1,4}),(.*)", re.ASCII | re.DOTALL)
_NUMBER = re.compile(r"[+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?", re.ASCII)
_MODEL = re.compile(r"\b(?:XPS|HXP)-[A-Z]+\d*", re.ASCII)


def read_reply(answer: bytes) -> Reply:
    """Decode an answer; ValueError if malformed."""
    match = matched(_REPLY, answer.decode("latin-1"), "no error number and comma at its beginning")
    return Reply(int(match[1]), match[2])


def read_numbers(text: str, count: int) -> tuple[float, ...]:
    """Decode a given count of numbers; ValueError."""
    values = text.split(",")
    if len(values) == count and all(map(_NUMBER.fullmatch, values)):
        numbers = tuple(map(float, values))
        if all(map(math.isfinite, numbers)):
            return numbers
    raise ValueError(f"'{text}' is not {count} number{'s' * (count > 1)}")


def read_model(firmware: str) -> str:
    """Decode the controller's model from its firmware version; ValueError if it is no XPS."""
    match = _MODEL.search(firmware)
    if match is None:
        raise ValueError(f"'{firmware}' is not the firmware of an XPS")
    return match[0]


# Parsing and messages of the simulator


class Call(NamedTuple):
    """A call as parsed by a controller: name, and input arguments."""

    name: str
    arguments: tuple[str, ...]


_CALL = re.compile(r"(\w+)\s*\(([^()]*)\)", re.ASCII)


def parse_call(text: str) -> Call:
    """Parse a complete call; ValueError."""
    match = matched(_CALL, text.strip(), "not a call")
    words = [word.strip() for word in match[2].split(",")]
    return Call(match[1], tuple(word for word in words if word and not word.endswith("*")))


def render(reply: Reply) -> bytes:
    """Encode an answer with its end."""
    return str(reply).encode("latin-1") + END
