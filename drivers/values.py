"""Values exchanged with drivers: readings, identities, states of instruments."""

from __future__ import annotations

from typing import Literal, NamedTuple

Approach = Literal["direct", "from_below", "from_above"]
"""From which side an axis comes to an angle at last."""


class Reading(NamedTuple):
    """A value of one channel and the loop time at which it was true; the channel's description names the unit."""

    at_s: float
    value: float


class Heard(NamedTuple):
    """Of a channel: the loop time of its last frame, and that by which its counts or its code had last changed."""

    frame_s: float
    pulse_s: float


class Identity(NamedTuple):
    """Who answered. `verified` is False if the instrument cannot report a serial number.

    `fingerprint` is what it can.
    """

    maker: str = ""
    model: str = ""
    serial: str = ""
    firmware: str = ""
    verified: bool = True
    fingerprint: str = ""

    @property
    def words(self) -> str:
        """The identity on one line; "" if empty."""
        return " ".join(filter(None, (self.maker, self.model, self.serial, self.firmware)))


class ChamberState(NamedTuple):
    """One coherent state of a chamber, °C; `set_point_c` is in force now and moves while the chamber ramps.

    `from_safe_c` is how far the last command is from the safe set point: 0 where the controller is switched off, None
    where the driver does not report it.
    """

    process_value_c: float
    set_point_c: float
    target_c: float
    from_safe_c: float | None = None


class SourceReading(NamedTuple):
    """Output of a supply or a source: V (None if it does not measure it), A, and whether it is on."""

    voltage_v: float | None
    current_a: float
    output: bool
