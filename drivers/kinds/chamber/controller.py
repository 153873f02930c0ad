"""What a dialect of a chamber's controller has to be able to do."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from drivers.description import IdentityPin
from drivers.values import Identity


class Control(Enum):
    """Who decides the temperature."""

    SET_POINT = "set point"  # the one that this driver commands
    NOBODY = "nobody"  # it is switched off or idle
    OTHER = "other"  # a profile, a person, an alarm


@dataclass(frozen=True, slots=True)
class Look:
    """State of a controller, °C.

    `set_point_c` is in force now; `target_c` is the last command, from any master. `why` states what else is in
    control, in the controller's words.
    """

    process_value_c: float
    set_point_c: float
    target_c: float
    control: Control = Control.SET_POINT
    why: str = ""


class Controller(Protocol):
    """One dialect on one wire. Nothing here decides; every method is a few exchanges.

    `limits_c` are the controller's own, once it is identified. `can_start`: whether a command may switch it on.
    Concurrency: one caller at a time.
    """

    limits_c: tuple[float, float] | None
    can_start: bool

    async def connect(self) -> None:
        """Reconnect and identify; raises CannotConnect, WrongIdentity."""

    def close(self) -> None:
        """Closes the wire; closing twice is harmless."""

    async def identify(self) -> Identity:
        """Who is there, the same as before; raises WrongIdentity, and closes the wire when it is not."""

    async def look(self, commanded_c: float | None) -> Look:
        """Read the state; `commanded_c` is the expected set point, if known."""

    async def command(self, temperature_c: float) -> None:
        """Writes the set point once and reads it back; Refused when something else was kept."""

    def kept(self, temperature_c: float) -> float:
        """The set point as the controller stores it, rounded as in its messages."""

    async def set_ramp(self, rate_c_per_min: float) -> None:
        """Makes the next set point one that is gone to at this rate; asked of controllers that ramp by themselves."""

    async def take_control(self) -> None:
        """Makes the set point count, after it was commanded; raises InstrumentFault where only a person may do that."""


class Connection(Protocol):
    """What a controller is spoken to over: it identifies the controller before it is used."""

    async def connect(self) -> None:
        """Reconnect and identify."""

    def close(self) -> None:
        """Closes the wire; the next exchange would open it again."""

    async def identify(self) -> None:
        """Identifies; raises WrongIdentity, and closes the wire when it is not the controller that it should be."""


class Connected:
    """The part of a Controller that is the same on every Connection; `_identity` is read once it has identified."""

    def __init__(self, connection: Connection) -> None:
        self.limits_c: tuple[float, float] | None = None
        self._connection = connection

    async def connect(self) -> None:
        """Reconnect and identify."""
        await self._connection.connect()

    def close(self) -> None:
        """Closes the wire; the next exchange would open it again."""
        self._connection.close()

    async def identify(self) -> Identity:
        """Who is there, the same as before; raises WrongIdentity, and closes the wire when it is not."""
        await self._connection.identify()
        return self._identity()

    def _identity(self) -> Identity:
        raise NotImplementedError


def as_stated(pin: IdentityPin, fingerprint: str, *, maker: str, model: str, firmware: str = "") -> Identity:
    """Identity of a controller that reports no names: those of the bench file, otherwise these, unverified."""
    return Identity(
        maker=pin.maker or maker, model=pin.model or model, serial=pin.serial or "",
        firmware=firmware or pin.firmware or "", verified=False, fingerprint=fingerprint,
    )  # fmt: skip
