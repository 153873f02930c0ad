"""Errors of a simulated voltmeter and of the load resistor that it measures on."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class VoltmeterSettings:
    """Connection of a voltmeter, and its errors as drawn: it reads U (1 + gain) + offset, and noise.

    Without a `place` no unit is connected to its load. `noise_v` is the standard deviation of a reading over 10 line
    cycles.
    """

    place: str
    load_ohm: float
    gain: float = 0.0
    offset_v: float = 0.0
    noise_v: float = 0.0
