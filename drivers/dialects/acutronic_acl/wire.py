"""ACL messages of an Acutrol3000 in both directions: lines out, length-prefixed answers back.

Sources: the maker's TM-8004 (ACL), TM-9384 (TCP/IP) and TM-9385 (interlocks). They do not specify the byte order of the
prefix, the format of registers (decoded here as decimal numbers), and the meaning of the error codes.
"""

from __future__ import annotations

from enum import Enum, IntFlag
from functools import lru_cache
from typing import Literal, NamedTuple, TypeVar

from drivers.protocols import scpi
from drivers.values import Identity

ByteOrder = Literal["little", "big"]
E = TypeVar("E", bound=Enum)

IDENTITY_QUERY = "*IDN?"
NO_ERROR = 0
PREFIX_BYTES = 8
TEXT_LIMIT_BYTES = 32_768
NOT_REPORTED = "0"  # IEEE 488.2 10.14.3: reported by an instrument that does not know its serial number


class Mode(Enum):
    """Servo modes of an axis; ACL also accepts their initials."""

    OFF = "Off"
    POSITION = "Position"
    RATE = "Rate"
    ABSOLUTE_RATE = "Arate"
    SYNTHESIS = "Synthesis"
    TRACK = "Track"


class Interlock(Enum):
    """Interlock of the drive of an axis; a fault stays until it is reset."""

    CLOSED = "Close"
    OPEN = "Open"
    FAULT = "Fault"


class Dynamics(IntFlag):
    """Used bits of A(n)DYN."""

    POSITION_COMPLETE = 1 << 8
    RATE_COMPLETE = 1 << 9
    AT_AMPLITUDE = 1 << 10
    AT_FREQUENCY = 1 << 11


class Supervisor(IntFlag):
    """Used bits of SUP0: lock-outs."""

    LOCKOUT = 1 << 2
    REMOTE_LOCKOUT = 1 << 3


LOCKED_OUT = Supervisor.LOCKOUT | Supervisor.REMOTE_LOCKOUT


_DYNAMICS, _SUPERVISOR = sum(Dynamics), sum(Supervisor)


class SoftwareFault(IntFlag):
    """Bits of A(n)SWFAULT."""

    ABORT = 1 << 0
    RATE_TRIP = 1 << 1
    TRACKING_ERROR = 1 << 2
    FRAME_TIME = 1 << 3
    PROGRAM = 1 << 4
    MISCORRELATION = 1 << 5
    CHECKSUM = 1 << 6
    FINE_TRANSDUCER = 1 << 7
    COARSE_TRANSDUCER = 1 << 8
    SELF_TEST = 1 << 9


class InterlockInput(IntFlag):
    """Bits of A(n)INTLK; those from 10 on are watchdogs inside the controller."""

    USER_INPUTS = 0x3F
    AMPLIFIER = 1 << 6
    INTERLOCK_1 = 1 << 7
    INTERLOCK_2 = 1 << 8
    MASTER_INTERLOCK = 1 << 9
    WATCHDOGS = 0xFC00


class Reply(NamedTuple):
    """An answer: an error code, and text, which is OK for a command."""

    code: int
    text: str

    def __str__(self) -> str:
        return f"error {self.code}, '{self.text}'" if self.code else f"'{self.text}'"


class State(NamedTuple):
    """State of an axis, from one servo frame: °, °/s, and motion."""

    angle_deg: float
    rate_dps: float
    interlock: Interlock
    mode: Mode
    dynamics: Dynamics
    supervisor: Supervisor


# Messages of the driver, some to be completed by the number of an axis

ENERGISE = ":INTERLOCK:CLOSE {}"  # the controller refuses while a fault is latched
STATE_QUERY = ":READ:POS? {0};RATE? {0};:INTERLOCK? {0};:MODE? {0};:STAT:CSR? A{0}DYN;CSR? SUP0"  # fields of a State
FAULTS_QUERY = ":STAT:CSR? A{0}SWFAULT;CSR? A{0}INTLK"  # registers with the cause of an interlock fault


def enter(mode: Mode, axis: int) -> str:
    """Command: follow the demand of a mode; OFF is the controlled stop, in which the servo holds rate zero."""
    return f":MODE:{mode.value.upper()} {axis}"


def limit(mode: Mode, axis: int, rate_dps: float, acceleration_dps2: float) -> tuple[str, str]:
    """Command: limit rate and acceleration of a mode."""
    place = f"{mode.value[0]},{axis}"
    return f":LIM:RATE {place},{_decimal(rate_dps)}", f":LIM:ACC {place},{_decimal(acceleration_dps2)}"


def demand_position(axis: int, angle_deg: float) -> str:
    """Command: target angle of POSITION; an axis without ends takes the shorter way."""
    return f":DEM:POS {axis},{_decimal(angle_deg)}"


def demand_rate(axis: int, rate_dps: float) -> str:
    """Command: rate of RATE."""
    return f":DEM:RATE {axis},{_decimal(rate_dps)}"


def configure_sine(axis: int, amplitude_slew_dps: float, frequency_slew_hz_per_s: float) -> str:
    """Command: prepare SYNTHESIS, with amplitude and frequency growing linearly from zero."""
    slews = f"{_decimal(amplitude_slew_dps)},{_decimal(frequency_slew_hz_per_s)}"
    return f":CONFIG:OSC {axis},Enable,{slews},Pos,Lin"


def demand_sine(axis: int, amplitude_deg: float, frequency_hz: float) -> str:
    """Command: sine of SYNTHESIS about the angle held by POSITION, from phase 0."""
    return f":DEM:OSC {axis},{_decimal(amplitude_deg)},{_decimal(frequency_hz)},0"


def lock_out(locked: bool) -> tuple[str, str]:
    """Command: lock out the front panel and other interfaces, or release them."""
    word = "ON" if locked else "OFF"
    return f":UTIL:LOCKOUT {word}", f":UTIL:REMOTELOCKOUT {word}"


# Decoding of answers


def whole_answer(received: bytes | bytearray, order: ByteOrder) -> tuple[int, int] | None:
    """Length of the first complete answer, prefix and text, twice; None until it is complete.

    For an invalid length all received bytes are the answer, which `read_reply` rejects.
    """
    if len(received) < PREFIX_BYTES:
        return None
    text = _text_length(received, order)
    whole = PREFIX_BYTES + text if text <= TEXT_LIMIT_BYTES else len(received)
    return (whole, whole) if len(received) >= whole else None


def read_reply(answer: bytes, order: ByteOrder) -> Reply:
    """Decode an answer; ValueError if its length differs from the stated one."""
    text = answer[PREFIX_BYTES:]
    if len(text) != (stated := _text_length(answer, order)):
        raise ValueError(
            f"the prefix states {stated} bytes, {len(text)} were received; is byte_order of the bench file right?"
        )
    code = int.from_bytes(answer[:4], order, signed=True)
    return Reply(code, text.decode("ascii").rstrip("\r\n"))


def read_identity(text: str) -> Identity:
    """Decode an identity such as `Acutronic R&D USA,Acutrol3000,0,A8800-…`; ValueError if it is no Acutrol.

    The serial number is unverified if the controller reports 0, which means unknown.
    """
    found = scpi.identity(text.encode("ascii"))
    if not found.model.lower().startswith("acutrol"):
        raise ValueError("it is not an Acutrol")
    known = found.serial != NOT_REPORTED
    return Identity(
        maker=found.maker, model=found.model, serial=found.serial if known else "", firmware=found.firmware,
        verified=known, fingerprint=text,
    )  # fmt: skip


def read_state(text: str) -> State:
    """Decode the answer to STATE_QUERY; ValueError."""
    angle, rate, interlock, mode, dynamics, supervisor = scpi.answers(text.encode("ascii"), 6)
    return State(
        scpi.number(angle), scpi.number(rate), spelled(interlock, Interlock), spelled(mode, Mode),
        Dynamics(scpi.integer(dynamics) & _DYNAMICS), Supervisor(scpi.integer(supervisor) & _SUPERVISOR),
    )  # fmt: skip


def read_faults(text: str) -> str:
    """Decode the answer to FAULTS_QUERY into text like "rate trip, master interlock"; ValueError."""
    software, inputs = (scpi.integer(part) for part in scpi.answers(text.encode("ascii"), 2))
    names = [name for name, bits in SoftwareFault.__members__.items() if bits & software]
    names += [name for name, bits in InterlockInput.__members__.items() if bits & inputs]
    return ", ".join(name.lower().replace("_", " ") for name in names)


@lru_cache(maxsize=256)
def spelled(text: str, words: type[E]) -> E:
    """Member with this name, in full or abbreviated, in any case; ValueError."""
    for word in words:
        if text and word.value.upper().startswith(text.upper()):
            return word
    raise ValueError(f"'{text}' is none of {', '.join(word.value for word in words)}")


# Messages of the simulator


def render(reply: Reply, order: ByteOrder) -> bytes:
    """Encode an answer as the controller sends it."""
    text = reply.text.encode("ascii")
    return reply.code.to_bytes(4, order, signed=True) + len(text).to_bytes(4, order) + text


def _text_length(answer: bytes | bytearray, order: ByteOrder) -> int:
    return int.from_bytes(answer[4:PREFIX_BYTES], order)


def _decimal(value: float) -> str:
    """Format as a plain decimal with up to six digits after the point: 1e-6° is 0.004 arcsec; never -0."""
    return f"{round(value, 6) + 0.0:.6f}".rstrip("0").rstrip(".")
