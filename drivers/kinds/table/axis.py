"""Interface of a dialect of a rate table."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple, Protocol

from drivers.values import Identity


class Mode(Enum):
    """Servo mode of an axis, with its name in messages."""

    OFF = "Off"
    POSITION = "Position"
    RATE = "Rate"
    SYNTHESIS = "Synthesis"
    OTHER = "Other"


class Drive(Enum):
    """State of the drive; a fault stays until a person resets it."""

    ON = "on"
    OFF = "off"
    FAULT = "fault"


class State(NamedTuple):
    """State of an axis: °, over whole turns, °/s, and motion.

    `held` is True if no motion is commanded: it may still be decelerating. `oscillating` is True if a sine has its full
    amplitude and frequency. `in_control` is True if no other master can command it; `words` are the controller's own.
    `stale` is True if a fault has frozen the reported values.
    """

    angle_deg: float
    rate_dps: float
    drive: Drive
    mode: Mode
    held: bool
    oscillating: bool
    in_control: bool
    words: str
    stale: bool = False

    def __str__(self) -> str:
        return f"{self.angle_deg:.5f}°, {self.rate_dps:.5f} °/s, {self.words}"


class TableAxis(Protocol):
    """One axis of one controller, without decisions; every method is a few exchanges.

    `longest_leg_deg` limits each move of a controller that takes the shorter way to an angle. Concurrency: callers
    queue for the line.
    """

    longest_leg_deg: float

    async def open(self) -> None:
        """Connect and identify; raises CannotConnect, WrongIdentity."""

    async def reopen(self) -> object:
        """Connect and identify again if the wire was lost; else nothing."""

    def close(self) -> None:
        """Close the wire; closing twice is harmless."""

    async def identify(self) -> Identity:
        """Query the identity; raises WrongIdentity if it has changed."""

    async def read_state(self) -> State:
        """Read the state of the axis."""

    async def check_fault(self, state: State, sent: str = "") -> None:
        """Raise InstrumentFault with its reasons if the state has a fault, met by `sent`; resets nothing."""

    async def make_ready(self) -> State:
        """Take control and energise the drive, unless that is so already; return the state after it.

        Raises InstrumentFault if a fault is latched, Refused if the drive stays off.
        """

    async def release_control(self) -> None:
        """Release control to other masters, if this session has taken it."""

    async def prepare(self, mode: Mode, rate_dps: float, acceleration_dps2: float) -> None:
        """Set rate and acceleration limits of a mode; moves nothing."""

    async def demand_here(self, mode: Mode, angle_deg: float) -> None:
        """Set the last demand of a mode to the present angle, or to rate zero; moves nothing."""

    async def demand_sine(self, amplitude_deg: float, frequency_hz: float, run_up_s: float) -> None:
        """Set the sine of SYNTHESIS, which grows for `run_up_s`; moves nothing."""

    async def change_sine(self, amplitude_deg: float, frequency_hz: float, slew_hz_per_s: float) -> None:
        """Change the frequency of the running sine at a constant rate, sent once; raises Refused, InstrumentFault."""

    async def enter(self, mode: Mode) -> None:
        """Make the servo follow the demand of a mode, sent once; raises Refused, InstrumentFault."""

    async def go(self, angle_deg: float) -> None:
        """Move the axis to an angle in POSITION, sent once; raises Refused, InstrumentFault."""

    async def turn(self, rate_dps: float) -> None:
        """Turn the axis at a rate in RATE, sent once; raises Refused, InstrumentFault."""

    async def stop(self) -> None:
        """Decelerate to rate zero and hold it; raises Refused, InstrumentFault."""

    def stop_at_once(self) -> None:
        """As `stop`, ahead of all queued messages; raises LinkLost."""
