"""Description of a device that sends frames unsolicited, known without importing its driver or numpy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

CODE = "code"  # unit of samples that are not decoded
WITH_THE_COUNTS = ""  # instead of the channel with which an encoder is latched


@dataclass(frozen=True, slots=True)
class Counted:
    """A channel of cumulative pulse counts, latched every `period_s`.

    `tick_period_s` is one count of the clock in the frames. `max_rate_pps` is the maximum pulse rate; it bounds the gap
    over which counts stay unambiguous.
    """

    unit: ClassVar[str] = "pulse/s"
    period_s: float
    tick_period_s: float
    max_rate_pps: float


class Sampled(NamedTuple):
    """A channel of samples, one every `period_s`, in `unit`.

    A sample is the mean over the period that ends at its tick where it is `averaged`, else the output at its tick.
    `stuck_after` consecutive equal samples mean that the unit no longer measures; None if that is not specified.
    """

    period_s: float
    tick_period_s: float
    unit: str = CODE
    averaged: bool = True
    stuck_after: int | None = None


Output = Counted | Sampled


class Encoder(NamedTuple):
    """Encoder of a table, latched every `period_s` with the counts, or with the samples of a `channel`."""

    resolution_arcsec: float
    period_s: float
    tick_period_s: float
    channel: str = WITH_THE_COUNTS


@dataclass(frozen=True, slots=True)
class BusLoad:
    """Maximum bus load in bit/s, and the bits of the encoder positions; 0 and none if not known."""

    bits_per_s: float = 0.0
    position_bits: Mapping[str, int] = field(default_factory=dict)


def _no_encoders(_options: object) -> Mapping[str, Encoder]:
    return {}


def _not_known(_options: object) -> BusLoad:
    return BusLoad()


class SentFrames(NamedTuple):
    """The frames of a driver's devices, as part of its description; each function takes the options of a device.

    `outputs` are the channels with outputs of units. `encoders` are latched with them, by the devices that drive their
    axes. `decoder` is the "module:callable" that makes a `drivers.can.decoded.FrameDecoder` from the options.
    `bus_load` may read files that the options name; it is called only where these exist.

    A file that an option names (a `Path`) is kept with a run under its own name; the options given to `decoder` then
    name the kept one.
    """

    outputs: Callable[[Any], Mapping[str, Output]]
    decoder: str
    encoders: Callable[[Any], Mapping[str, Encoder]] = _no_encoders
    bus_load: Callable[[Any], BusLoad] = _not_known
