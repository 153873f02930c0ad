"""Newport XPS calls and answers in both directions, without the end of an answer.

A call is written as a C function is, and nothing ends it but its parenthesis; what is wanted back stands in it as a
type. The answer is a number, 0 when all is well, what was asked for, and `EndOfAPI`; after any other number the call
itself is quoted. Wire facts are those that drivers of others agree on (the package newportxps, ESRF's BLISS, JPL's
golaborate): no maker's manual was read.
"""

from __future__ import annotations

import math
import re
from enum import Enum
from typing import NamedTuple

END = b",EndOfAPI"
SUCCESS = 0
BUSY = -1  # the call before is not answered yet on this connection
UNKNOWN_COMMAND = -4
POSITIONER_ERROR = -5
WRONG_FORMAT = -7
PARAMETER_OUT_OF_RANGE = -17
POSITIONER_NAME = -18
GROUP_NAME = -19
NOT_ALLOWED = -22  # in this state of the group; to an abort: nothing moves
FOLLOWING_ERROR = -25
EMERGENCY = -26
ABORTED = -27
TRAVEL_LIMITS = -35
WRONG_PASSWORD = -106


class Reply(NamedTuple):
    """An answer: the number that says how the call went, and what was asked for or the call."""

    code: int
    text: str

    def __str__(self) -> str:
        return f"{self.code},{self.text}"


class GroupState(Enum):
    """What the numbers of a group's status come to."""

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
    """What a number of GroupStatusGet means; emergency braking, homing, jogging and spinning are moving."""
    return next((state for state, numbers in _STATES.items() if status in numbers), GroupState.OTHER)


class Profile(NamedTuple):
    """How a positioner moves: °/s, °/s², and the least and the most time its acceleration takes to change, s."""

    rate_dps: float
    acceleration_dps2: float
    min_jerk_s: float
    max_jerk_s: float


# What a driver sends, and how it reads the answers

ASK_FIRMWARE = "FirmwareVersionGet(char *)"


def move_absolute(positioner: str, angle_deg: float) -> str:
    """Goes to an angle; answered when it has arrived."""
    return f"GroupMoveAbsolute({positioner},{_decimal(angle_deg)})"


def abort(group: str) -> str:
    """Decelerates and holds; the call of the move is then answered with ABORTED."""
    return f"GroupMoveAbort({group})"


def enable(group: str) -> str:
    """Closes the servo loop of a group that a command disabled."""
    return f"GroupMotionEnable({group})"


def set_profile(positioner: str, profile: Profile) -> str:
    """How the next moves are made."""
    return f"PositionerSGammaParametersSet({positioner},{','.join(_decimal(value) for value in profile)})"


def ask_profile(positioner: str) -> str:
    """How moves are made."""
    return f"PositionerSGammaParametersGet({positioner},double *,double *,double *,double *)"


def ask_angle(positioner: str) -> str:
    """Where the encoder is, °."""
    return f"GroupPositionCurrentGet({positioner},double *)"


def ask_status(group: str) -> str:
    """The number of the group's status."""
    return f"GroupStatusGet({group},int *)"


def ask_status_words(status: int) -> str:
    """That number in words."""
    return f"GroupStatusStringGet({status},char *)"


def ask_error(positioner: str) -> str:
    """The positioner's error, which this leaves as it is; PositionerErrorGet would clear it."""
    return f"PositionerErrorRead({positioner},int *)"


def ask_error_words(error: int) -> str:
    """A positioner's error in words."""
    return f"PositionerErrorStringGet({error},char *)"


def ask_code_words(code: int) -> str:
    """In words, the number that an answer begins with."""
    return f"ErrorStringGet({code},char *)"


def ask_travel(positioner: str) -> str:
    """The least and the greatest target, °."""
    return f"PositionerUserTravelLimitsGet({positioner},double *,double *)"


def ask_fastest(positioner: str) -> str:
    """The highest rate, °/s, and acceleration, °/s²."""
    return f"PositionerMaximumVelocityAndAccelerationGet({positioner},double *,double *)"


_REPLY = re.compile(r"(-?\d{1,4}),(.*)", re.ASCII | re.DOTALL)
_NUMBER = re.compile(r"[+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?", re.ASCII)
_INTEGER = re.compile(r"[+-]?\d{1,10}", re.ASCII)
_MODEL = re.compile(r"\b(?:XPS|HXP)-[A-Z]+\d*", re.ASCII)


def read_reply(answer: bytes) -> Reply:
    """An answer; ValueError when it is none."""
    match = _REPLY.fullmatch(answer.decode("latin-1"))
    if match is None:
        raise ValueError("no number and comma at its beginning")
    return Reply(int(match[1]), match[2])


def read_numbers(text: str, count: int) -> tuple[float, ...]:
    """So many numbers; ValueError."""
    values = text.split(",")
    if len(values) == count and all(map(_NUMBER.fullmatch, values)):
        numbers = tuple(map(float, values))
        if all(map(math.isfinite, numbers)):
            return numbers
    raise ValueError(f"'{text}' is not {count} number{'s' * (count > 1)}")


def read_integer(text: str) -> int:
    """A whole number; ValueError."""
    if not _INTEGER.fullmatch(text):
        raise ValueError(f"'{text}' is not a whole number")
    return int(text)


def read_model(firmware: str) -> str:
    """The controller's model, which the version of its firmware begins with; ValueError when it is no XPS."""
    match = _MODEL.search(firmware)
    if match is None:
        raise ValueError(f"'{firmware}' is not the firmware of an XPS")
    return match[0]


def _decimal(value: float) -> str:
    """A plain decimal with up to six digits after the point: 1e-6° is 0.004 arcsec; never -0."""
    whole, _, digits = f"{round(value, 6) + 0.0:.6f}".partition(".")
    return f"{whole}.{digits.rstrip('0') or '0'}"


# Parsing and messages of the simulator


class Call(NamedTuple):
    """A call as a controller reads it: its name, and its arguments without the types of what is wanted back."""

    name: str
    arguments: tuple[str, ...]


_CALL = re.compile(r"(\w+)\s*\(([^()]*)\)", re.ASCII)


def parse_call(text: str) -> Call:
    """A whole call; ValueError."""
    match = _CALL.fullmatch(text.strip())
    if match is None:
        raise ValueError("not a call")
    words = [word.strip() for word in match[2].split(",")]
    return Call(match[1], tuple(word for word in words if word and not word.endswith("*")))


def render(reply: Reply) -> bytes:
    """An answer as the controller sends it, with its end."""
    return str(reply).encode("latin-1") + END
