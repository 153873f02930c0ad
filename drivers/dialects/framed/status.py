"""Content of a status frame, in the units of the bench."""

from __future__ import annotations

from typing import NamedTuple

from drivers.dialects.framed.parts import Bit, Count
from drivers.dialects.framed.profile import FrameProfile
from drivers.dialects.framed.wire import NumberFormat, Raw

EMERGENCY_STOP = "emergency stop"
_MODES = ("off", "position", "rate", "sine")


class Status(NamedTuple):
    """One status: °, °/s; None if the profile does not describe it. Targets are in wire units.

    `mode` is a key of the profile's modes, or the number of an unlisted one; "" if the status reports none.
    """

    angle_deg: float
    rate_dps: float | None
    moving: bool
    enabled: bool
    homed: bool
    in_position: bool
    at_sine: bool
    remote: bool
    faults: tuple[str, ...] = ()
    mode: str = ""
    target_angle: Raw | None = None
    target_rate: Raw | None = None
    serial_number: Raw | None = None
    firmware: Raw | None = None

    def __str__(self) -> str:
        words = ["enabled" if self.enabled else "disabled", "moving" if self.moving else "at rest"]
        words += [f"mode {self.mode}"] if self.mode else []
        return ", ".join([*words, *self.faults])


class StatusReader:
    """Reads the status frames of a profile."""

    def __init__(self, profile: FrameProfile) -> None:
        status = profile.status
        self._states, self._faults, self._mode = status.states, status.faults, status.mode
        self._angle = profile.number(status.angle)
        self._rate = None if status.rate is None else profile.number(status.rate)
        self._mode_form = None if status.mode is None else profile.number(status.mode)
        self._raw = {
            name: profile.number(found)
            for name in ("target_angle", "target_rate", "serial_number", "firmware")
            if (found := getattr(status, name)) is not None
        }
        self._counter, self._answers = (_form(profile, count) for count in (status.counter, status.answers))
        self.counter_range = 1 << 8 * (self._counter.end - self._counter.at) if self._counter is not None else 0

    def counter(self, frame: bytes) -> Raw | None:
        """Sequence number of a status, if it has one."""
        return None if self._counter is None else self._counter.read(frame)

    def answers(self, frame: bytes) -> Raw | None:
        """The request counter in a status, if it has one."""
        return None if self._answers is None else self._answers.read(frame)

    def read(self, frame: bytes) -> Status:
        """Decode a frame; ValueError for a number that is not finite."""
        states = self._states
        pressed = states.emergency_stop is not None and states.emergency_stop.read(frame)
        faults = [text for fault in self._faults if (text := fault.text(frame))]
        return Status(
            self._angle.value(self._angle.read(frame)),
            None if self._rate is None else self._rate.value(self._rate.read(frame)),
            moving=states.moving.read(frame),
            enabled=_holds(states.enabled, frame),
            homed=_holds(states.homed, frame),
            in_position=_holds(states.in_position, frame),
            at_sine=_holds(states.at_sine, frame),
            remote=_holds(states.remote, frame),
            faults=tuple([EMERGENCY_STOP, *faults] if pressed else faults),
            mode=self._read_mode(frame),
            **{name: form.read(frame) for name, form in self._raw.items()},
        )

    def _read_mode(self, frame: bytes) -> str:
        if self._mode is None or self._mode_form is None:
            return ""
        number = self._mode_form.read(frame)
        return next((name for name in _MODES if getattr(self._mode, name) == number), str(number))


def _holds(bit: Bit | None, frame: bytes) -> bool:
    """Evaluate a state; it is always true if no bit reports it."""
    return bit is None or bit.read(frame)


def _form(profile: FrameProfile, count: Count | None) -> NumberFormat | None:
    return None if count is None else profile.number(count)
