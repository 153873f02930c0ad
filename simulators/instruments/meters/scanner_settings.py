"""Settings of a simulated scanner that are kept for each channel and change nothing of what is simulated."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from simulators.instruments.meters.scanner_sweeps import exponential
from simulators.instruments.scpi import Handler
from simulators.instruments.stored_settings import Kept, kept_number, kept_switch, kept_word

Channels = Callable[[str], tuple[int, ...]]
"""The channels of a list like `(@101:103)`, those of the scan for none; raises Refusal."""

_TRANSDUCER = "[SENSe:]TEMPerature:TRANsducer"
_OHM = kept_number(100.0, 49.0, 2100.0, exponential)
KEPT: Mapping[str, Kept] = {
    "[SENSe:]TEMPerature:NPLC": kept_number(1.0, 0.02, 200.0, exponential),
    f"{_TRANSDUCER}:TC:CHECk": kept_switch("0"),
    f"{_TRANSDUCER}:TC:RJUNction": kept_number(0.0, -20.0, 80.0, exponential),
    f"{_TRANSDUCER}:TC:RJUNction:TYPE": kept_word("INT", "INTernal", "EXTernal", "FIXed"),
    f"{_TRANSDUCER}:RTD:RESistance[:REFerence]": _OHM,
    f"{_TRANSDUCER}:FRTD:RESistance[:REFerence]": _OHM,
    "ROUTe:CHANnel:DELay": kept_number(0.0, 0.0, 60.0, exponential),
    "ROUTe:CHANnel:DELay:AUTO": kept_switch("1"),
}


class ChannelSettings:
    """The settings of every channel, as last set."""

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
