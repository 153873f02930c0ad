"""Interface of a dialect of a chamber's controller."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple, Protocol

from drivers.values import Identity


class Control(Enum):
    """Source of the active set point."""

    SET_POINT = "set point"  # the set point commanded by this driver
    IDLE = "nobody"  # switched off or idle
    FOREIGN = "other"  # a profile, a person, an alarm


class ControllerState(NamedTuple):
    """State of a controller, °C.

    `set_point_c` is the active set point; `target_c` is the last command, from any master. `why` names another source
    of control, in the controller's words.
    """

    process_value_c: float
    set_point_c: float
    target_c: float
    control: Control = Control.SET_POINT
    why: str = ""


class Controller(Protocol):
    """One dialect on one connection, without decisions; every method is a few exchanges.

    `limits_c` are the controller's own, known after identification. `can_start` is True if a command may switch it on.
    Concurrency: one caller at a time.
    """

    limits_c: tuple[float, float] | None
    can_start: bool

    async def connect(self) -> None:
        """Reconnect and identify; raises CannotConnect, WrongIdentity."""

    def close(self) -> None:
        """Close the wire; closing twice is harmless."""

    async def identify(self) -> Identity:
        """Query the identity; raises WrongIdentity, and closes the connection, if it has changed."""

    async def read_state(self, commanded_c: float | None) -> ControllerState:
        """Read the state; `commanded_c` is the expected set point, if known."""

    async def command(self, temperature_c: float) -> None:
        """Write the set point once and read it back; Refused if another value was stored."""

    def as_stored(self, temperature_c: float) -> float:
        """The set point as the controller stores it, rounded as in its messages."""

    async def set_ramp(self, rate_c_per_min: float) -> None:
        """Set the ramp rate of the next set point; called only for controllers that ramp by themselves."""

    async def take_control(self) -> None:
        """Make a commanded set point active; raises InstrumentFault if only a person may do that."""


class Connection(Protocol):
    """Connection to a controller, which is identified before use."""

    async def connect(self) -> None:
        """Reconnect and identify."""

    def close(self) -> None:
        """Close the connection; the next exchange would reopen it."""

    async def identify(self) -> None:
        """Identify; raises WrongIdentity, and closes the connection, if it is another controller."""


class Connected:
    """Common part of a Controller on any Connection; `_identity` is called after identification."""

    def __init__(self, connection: Connection) -> None:
        self.limits_c: tuple[float, float] | None = None
        self._connection = connection

    async def connect(self) -> None:
        """Reconnect and identify."""
        await self._connection.connect()

    def close(self) -> None:
        """Close the connection; the next exchange would reopen it."""
        self._connection.close()

    async def identify(self) -> Identity:
        """Query the identity; raises WrongIdentity, and closes the connection, if it has changed."""
        await self._connection.identify()
        return self._identity()

    async def set_ramp(self, rate_c_per_min: float) -> None:
        """Never called for a controller that does not ramp by itself; others override it."""
        raise NotImplementedError

    def _identity(self) -> Identity:
        raise NotImplementedError
