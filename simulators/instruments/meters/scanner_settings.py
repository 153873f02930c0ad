"""Settings of a simulated scanner that are stored per channel and have no effect on the simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from simulators.instruments.meters.scanner_sweeps import exponential
from simulators.instruments.scpi import Handler
from simulators.instruments.stored_settings import Kept, kept_number, kept_switch, kept_word

Channels = Callable[[str], tuple[int, ...]]
"""Parse a channel list like `(@101:103)`, empty for the scan list; raises Refusal."""

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
    """Settings of every channel."""

    def __init__(self, channels: Channels) -> None:
        self._channels = channels
        self._told: dict[tuple[str, int], str] = {}

    def commands(self) -> dict[str, Handler]:
        """Handlers of settings and queries, by header."""
        setters = {header: self._setter(header) for header in KEPT}
        return setters | {f"{header}?": self._teller(header) for header in KEPT}

    def reset(self) -> None:
        """Reset all settings to their defaults."""
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
