"""Values exchanged with drivers: readings, identities, states of instruments."""

from __future__ import annotations

from typing import Literal, NamedTuple

Approach = Literal["direct", "from_below", "from_above"]
"""Direction of the final approach of an axis to an angle."""


class Reading(NamedTuple):
    """A value of one channel and the loop time at which it was valid; the channel's description names the unit."""

    at_s: float
    value: float


class LastSeen(NamedTuple):
    """Of a channel: loop time of its last frame, and of the last change of its counts or code."""

    frame_s: float
    change_s: float


class Identity(NamedTuple):
    """Identity of an instrument. `verified` is False if it cannot report a serial number.

    `fingerprint` holds other properties that it reports.
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
    """One consistent state of a chamber, °C; `set_point_c` is the active set point, which moves during a ramp.

    `from_safe_c` is the distance of the last command from the safe set point: 0 if the controller is switched off, None
    if the driver does not report it.
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
