"""Waves of a Keithley 6221: settings, and the states armed and running.

Headers are those of PyMeasure's driver. Bits of the operation register are those of the reference manual, figure 11-1;
the bit of a stopped wave is PyMeasure's. As in third-party programs, amplitude, frequency and offset can be set while a
wave is armed or runs, but not shape, duration and range.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from enum import IntFlag

from drivers.dialects.keithley_6220 import wire
from drivers.protocols import scpi
from simulators.instruments.scpi import SETTINGS_CONFLICT, Handler, Refusal
from simulators.instruments.stored_settings import (
    StoredSetting,
    StoredSettings,
    stored_number,
    stored_switch,
    stored_word,
)

_WAVE = "[SOURce:]WAVE"
_AMPLITUDE, _OFFSET = f"{_WAVE}:AMPLitude", f"{_WAVE}:OFFSet"
_DURATION_S, _CYCLES, _FREQUENCY = f"{_WAVE}:DURation:TIME", f"{_WAVE}:DURation:CYCLes", f"{_WAVE}:FREQuency"
_FUNCTION, _RANGE = f"{_WAVE}:FUNCtion", f"{_WAVE}:RANGing"
_LEVEL_MAX_A = wire.OVER_RANGE * wire.RANGES_A[-1]
_ARBITRARY = ("ARBitrary0", "ARBitrary1", "ARBitrary2", "ARBitrary3", "ARBitrary4")
_NOT_WHILE_ARMED = (_FUNCTION, _RANGE, _DURATION_S, _CYCLES)


class Operation(IntFlag):
    """Used bits of the operation registers."""

    WAVE_STARTED = 1 << 4
    WAVE_STOPPED = 1 << 7
    IDLE = 1 << 10


def _spelled(value: float) -> str:
    return f"{value:.6E}"


def _endless(most: float) -> StoredSetting:
    """Parse a duration: a number, or INF, reported as SCPI infinity."""
    number = stored_number(most, 1e-7, most, _spelled)
    infinity = _spelled(scpi.NOT_A_NUMBER)
    return StoredSetting(
        infinity, lambda argument: infinity if argument.upper().startswith("INF") else number.reported(argument)
    )


_SETTINGS: Mapping[str, StoredSetting] = {
    _FUNCTION: stored_word("SIN", "SINusoid", "SQUare", "RAMP", *_ARBITRARY),
    _FREQUENCY: stored_number(1e3, 1e-3, 1e5, _spelled),
    _AMPLITUDE: stored_number(1e-3, 2e-12, _LEVEL_MAX_A, _spelled),
    _OFFSET: stored_number(0.0, -_LEVEL_MAX_A, _LEVEL_MAX_A, _spelled),
    f"{_WAVE}:DCYCle": stored_number(50.0, 0.0, 100.0, _spelled),
    _DURATION_S: _endless(999999.999),
    _CYCLES: _endless(99999999900.0),
    _RANGE: stored_word("BEST", "BEST", "FIXed"),
    f"{_WAVE}:PMARk[:LEVel]": stored_number(180.0, -180.0, 360.0, _spelled),
    f"{_WAVE}:PMARk:STATe": stored_switch("0"),
    f"{_WAVE}:PMARk:OLINe": stored_number(3, 1, 6, lambda line: str(round(line))),
}


class Waves:
    """Wave generator of a source; `switch` switches its output on at the start of a wave. `now_s` is the true time."""

    def __init__(self, switch: Callable[[bool], None], now_s: Callable[[], float]) -> None:
        self._switch, self._now_s = switch, now_s
        self._settings = StoredSettings(_SETTINGS)
        self._events = Operation(0)
        self.reset()

    def reset(self) -> None:
        """Disarm and reset all settings to their defaults."""
        self._settings.reset()
        self._armed, self._runs, self._ends_s = False, False, math.inf

    @property
    def runs(self) -> bool:
        """True while a wave runs; one with a duration ends by itself."""
        self._end_when_over()
        return self._runs

    @property
    def mean_a(self) -> float:
        """Mean current of the wave: its offset."""
        return float(self._settings[_OFFSET])

    @property
    def events(self) -> Operation:
        """Events since the last query."""
        self._end_when_over()
        return self._events

    def commands(self) -> dict[str, Handler]:
        """Handlers to set, arm, start and end a wave, by header."""
        told = self._settings.commands()
        return {
            **{header: self._unless_armed(put) if header in _NOT_WHILE_ARMED else put for header, put in told.items()},
            f"{_WAVE}:ARM": self._arm,
            f"{_WAVE}:INITiate": self._begin,
            f"{_WAVE}:ABORt": self._abort,
            "STATus:OPERation:CONDition?": lambda _: str(int(self._condition())),
            "STATus:OPERation[:EVENt]?": self._take_events,
        }

    def _unless_armed(self, put: Handler) -> Handler:
        def put_or_refuse(argument: str) -> str | None:
            if self._armed:
                raise Refusal(SETTINGS_CONFLICT)
            return put(argument)

        return put_or_refuse

    def _arm(self, _: str) -> None:
        if self._armed or abs(self.mean_a) + float(self._settings[_AMPLITUDE]) > _LEVEL_MAX_A:
            raise Refusal(SETTINGS_CONFLICT)
        self._armed = True

    def _begin(self, _: str) -> None:
        if not self._armed or self.runs:
            raise Refusal(SETTINGS_CONFLICT)
        self._switch(True)
        self._runs = True
        self._events |= Operation.WAVE_STARTED
        cycles_s = float(self._settings[_CYCLES]) / float(self._settings[_FREQUENCY])
        lasts_s = min(float(self._settings[_DURATION_S]), cycles_s)
        self._ends_s = self._now_s() + lasts_s if lasts_s < scpi.NOT_A_NUMBER / 1e5 else math.inf

    def _end_when_over(self) -> None:
        if self._runs and self._now_s() >= self._ends_s:
            self._stop()

    def _abort(self, _: str) -> None:
        if self.runs:
            self._stop()
        self._armed = False

    def _stop(self) -> None:
        self._runs = False
        self._switch(False)
        self._events |= Operation.WAVE_STOPPED

    def _condition(self) -> Operation:
        if self.runs:
            return Operation.WAVE_STARTED
        return Operation(0) if self._armed else Operation.IDLE

    def _take_events(self, _: str) -> str:
        events, self._events = self.events, Operation(0)
        return str(int(events))
