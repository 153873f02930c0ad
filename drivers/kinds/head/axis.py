"""Interface of a dialect of a motion controller."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from drivers.transport.double_read import DoubleRead
from drivers.values import Identity, Reading

ANSWER_S = 2.0


class AxisState(NamedTuple):
    """State of an axis reported by a controller; `words` are its own text, if any."""

    homed: bool
    enabled: bool
    moving: bool
    in_position: bool
    words: str = ""


class OwnLimits(NamedTuple):
    """The controller's own limits of an axis."""

    min_deg: float
    max_deg: float
    rate_dps: float


class Axis(Protocol):
    """One axis of one controller, without decisions; every method is a few exchanges.

    `limits` are the controller's own, known after `open` if it reports them; `double_read` confirms readings that enter
    a result. Concurrency: callers queue for the line.
    """

    limits: OwnLimits | None

    @property
    def double_read(self) -> DoubleRead:
        """Confirmation of readings that enter a result."""

    async def open(self) -> None:
        """Connect and identify; raises CannotConnect, WrongIdentity."""

    async def reopen(self) -> object:
        """Reconnect if the connection was lost; else do nothing."""

    def close(self) -> None:
        """Close the wire; closing twice is harmless."""

    async def identify(self) -> Identity:
        """Query the identity; raises WrongIdentity if it has changed."""

    async def angle(self) -> Reading:
        """Encoder angle (°)."""

    async def state(self) -> AxisState:
        """State: homed, energised, moving, at rest."""

    async def check_faults(self) -> None:
        """Raise InstrumentFault with the faults reported for the axis; acknowledges nothing."""

    async def enable(self) -> object:
        """Energise the motor; raises Refused unless the state confirms it."""

    async def prepare(self, rate_dps: float) -> None:
        """Send motion settings that precede moves, if the controller has any; raises Refused."""

    async def start_move(self, angle_deg: float, rate_dps: float, *, answer_s: float) -> None:
        """Start a move to an angle at the prepared rate, as a single command sent once.

        Returns when the controller has accepted or finished the move, or after `answer_s` if the answer is missing: the
        caller decides by the angle. Raises Refused, InstrumentFault.
        """

    async def abort(self) -> None:
        """Decelerate and hold; raises Refused."""

    def abort_at_once(self) -> None:
        """As `abort`, ahead of all queued messages; queued moves are not sent any more. Raises LinkLost."""
