"""What a dialect of a rate table has to be able to do."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple, Protocol

from drivers.timing.readback import ReadBack
from drivers.values import Identity

READ_BACK = ReadBack()  # from a command to the status that tells it


class Mode(Enum):
    """What the servo of an axis follows, as the technician reads it."""

    OFF = "Off"
    POSITION = "Position"
    RATE = "Rate"
    SYNTHESIS = "Synthesis"
    OTHER = "Other"


class Drive(Enum):
    """Whether the motor is energised; a fault stays until a person resets it."""

    ON = "on"
    OFF = "off"
    FAULT = "fault"


class State(NamedTuple):
    """One look at an axis: °, over whole turns, °/s, and what it is doing.

    `held` is whether nothing turns it any more: it may still be slowing down. `swinging` is whether a sine has its full
    amplitude and frequency. `ours` is whether nobody else can command it; `words` are the controller's own. `stale` is
    whether a fault has frozen what is told.
    """

    angle_deg: float
    rate_dps: float
    drive: Drive
    mode: Mode
    held: bool
    swinging: bool
    ours: bool
    words: str
    stale: bool = False

    def __str__(self) -> str:
        return f"{self.angle_deg:.5f}°, {self.rate_dps:.5f} °/s, {self.words}"


class TableAxis(Protocol):
    """One axis of one controller. Nothing here decides; every method is a few exchanges.

    A controller that takes the shorter way to an angle is sent no farther than `longest_leg_deg` at once. Concurrency:
    callers queue for the line.
    """

    longest_leg_deg: float

    async def open(self) -> None:
        """Connects and identifies; raises CannotConnect, WrongIdentity."""

    async def reopen(self) -> None:
        """Connects and identifies again if the wire was lost; else nothing."""

    def close(self) -> None:
        """Closes the wire; closing twice is harmless."""

    async def identify(self) -> Identity:
        """Who is there, the same as before; raises WrongIdentity."""

    async def look(self) -> State:
        """What the axis does now."""

    async def check_fault(self, state: State, sent: str = "") -> None:
        """Raises InstrumentFault with its reasons when the state has a fault, which `sent` met; resets nothing."""

    async def make_ready(self) -> State:
        """Takes control and energises the drive, unless that is so already; what the axis then does.

        Raises InstrumentFault when a fault is latched, Refused when the drive stays off.
        """

    async def give_back(self) -> None:
        """Lets others command the axis again, if this session has kept them from it."""

    async def prepare(self, mode: Mode, rate_dps: float, acceleration_dps2: float) -> None:
        """Tells how fast a mode moves the axis and changes its rate; moves nothing."""

    async def demand_here(self, mode: Mode, angle_deg: float) -> None:
        """Makes the last demand of a mode the angle where the axis stands, or rate zero; moves nothing."""

    async def demand_sine(self, amplitude_deg: float, frequency_hz: float, run_up_s: float) -> None:
        """Tells how SYNTHESIS is to swing, growing for `run_up_s`; moves nothing."""

    async def enter(self, mode: Mode) -> None:
        """Make the servo follow the demand of a mode, once; raises Refused, InstrumentFault."""

    async def go(self, angle_deg: float) -> None:
        """Sends the axis to an angle, once, in POSITION; raises Refused, InstrumentFault."""

    async def turn(self, rate_dps: float) -> None:
        """Sends the axis to a rate, once, in RATE; raises Refused, InstrumentFault."""

    async def stop(self) -> None:
        """Slows down to rate zero and holds it; raises Refused, InstrumentFault."""

    def stop_at_once(self) -> None:
        """As `stop`, before anything else that is to be said; raises LinkLost."""
