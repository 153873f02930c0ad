"""Settings of the channels of a simulated scanner that change nothing of what is simulated: kept, and told again."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from simulators.scanner_sweeps import exponential
from simulators.scpi import ILLEGAL_VALUE, Handler, Refusal, setting, switch

Channels = Callable[[str], tuple[int, ...]]
"""The channels of a list like `(@101:103)`, those of the scan for none; raises Refusal."""

_JUNCTIONS = {"INT": "INT", "INTERNAL": "INT", "EXT": "EXT", "EXTERNAL": "EXT", "FIX": "FIX", "FIXED": "FIX"}


@dataclass(frozen=True, slots=True)
class _Kept:
    """A setting: what it is out of the box, and how an argument is told again; that raises Refusal."""

    first: str
    told: Callable[[str], str]


def between(low: float, high: float) -> Callable[[str], str]:
    """How a number in a range is told again."""
    return lambda argument: exponential(setting(argument, low, high))


def _junction(argument: str) -> str:
    if argument.upper() not in _JUNCTIONS:
        raise Refusal(ILLEGAL_VALUE)
    return _JUNCTIONS[argument.upper()]


_TRANSDUCER = "[SENSe:]TEMPerature:TRANsducer"
_OHM = _Kept(exponential(100.0), between(49.0, 2100.0))
_SWITCH = {on: _Kept(on, lambda argument: str(int(switch(argument)))) for on in "01"}
KEPT: Mapping[str, _Kept] = {
    "[SENSe:]TEMPerature:NPLC": _Kept(exponential(1.0), between(0.02, 200.0)),
    f"{_TRANSDUCER}:TC:CHECk": _SWITCH["0"],
    f"{_TRANSDUCER}:TC:RJUNction": _Kept(exponential(0.0), between(-20.0, 80.0)),
    f"{_TRANSDUCER}:TC:RJUNction:TYPE": _Kept("INT", _junction),
    f"{_TRANSDUCER}:RTD:RESistance[:REFerence]": _OHM,
    f"{_TRANSDUCER}:FRTD:RESistance[:REFerence]": _OHM,
    "ROUTe:CHANnel:DELay": _Kept(exponential(0.0), between(0.0, 60.0)),
    "ROUTe:CHANnel:DELay:AUTO": _SWITCH["1"],
}


class ChannelSettings:
    """The settings of every channel, as they were told last."""

    def __init__(self, channels: Channels) -> None:
        self._channels = channels
        self._told: dict[tuple[str, int], str] = {}

    def commands(self) -> dict[str, Handler]:
        """What sets them and what asks for them, by header."""
        setters = {header: self._setter(header) for header in KEPT}
        return setters | {f"{header}?": self._teller(header) for header in KEPT}

    def reset(self) -> None:
        """All are as out of the box."""
        self._told.clear()

    def _setter(self, header: str) -> Handler:
        def put(argument: str) -> None:
            value, _, channels = argument.partition(",")
            told = KEPT[header].told(value.strip())
            self._told.update({(header, channel): told for channel in self._channels(channels)})

        return put

    def _teller(self, header: str) -> Handler:
        def tell(argument: str) -> str:
            first = KEPT[header].first
            return ",".join(self._told.get((header, channel), first) for channel in self._channels(argument))

        return tell
