"""What a dialect of a motion controller has to be able to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from drivers.timing.readback import ReadBack
from drivers.transport.double_read import Takes
from drivers.values import Identity, Reading

ANSWER_S = 2.0
READ_BACK = ReadBack()


@dataclass(frozen=True, slots=True)
class AxisState:
    """What a controller says of an axis; `words` are its own, where it has any."""

    homed: bool
    enabled: bool
    moving: bool
    in_position: bool
    words: str = ""


@dataclass(frozen=True, slots=True)
class OwnLimits:
    """What a controller itself allows an axis."""

    min_deg: float
    max_deg: float
    rate_dps: float


class Axis(Protocol):
    """One axis of one controller. Nothing here decides; every method is a few exchanges.

    `limits` are the controller's own, once it is open and where it tells them; `takes` are of what enters a result.
    Concurrency: callers queue for the line.
    """

    limits: OwnLimits | None
    takes: Takes

    async def open(self) -> None:
        """Connects and identifies; raises CannotConnect, WrongIdentity."""

    async def reopen(self) -> None:
        """Connects again if the wire was lost; else nothing."""

    def close(self) -> None:
        """Closes the wire; closing twice is harmless."""

    async def identify(self) -> Identity:
        """Who is there, the same as before; raises WrongIdentity."""

    async def angle(self) -> Reading:
        """The encoder's angle (°)."""

    async def state(self) -> AxisState:
        """Whether it is homed, energised, moves, stands."""

    async def check_faults(self) -> None:
        """Raises InstrumentFault with what the controller says of the axis; acknowledges nothing."""

    async def enable(self) -> None:
        """Energises the motor; raises Refused unless the state says so afterwards."""

    async def prepare(self, rate_dps: float) -> None:
        """Tells the controller how moves are to be made, where that is said before them; raises Refused."""

    async def start_move(self, angle_deg: float, rate_dps: float, *, answer_s: float) -> None:
        """Sends the axis to an angle, once, at a rate that it was prepared for; says nothing else before.

        Returns when the controller has accepted the move, or has done it, or within `answer_s` when the answer is
        missing: the angle decides. Raises Refused, InstrumentFault.
        """

    async def abort(self) -> None:
        """Lets the axis decelerate and hold; raises Refused."""

    def abort_at_once(self) -> None:
        """As `abort`, before anything else that is to be said, and no move that waits is sent; raises LinkLost."""
