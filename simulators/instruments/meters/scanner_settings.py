"""Settings of a simulated scanner that are stored per channel and have no effect on the simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from simulators.instruments.meters.scanner_sweeps import exponential
from simulators.instruments.scpi import Handler
from simulators.instruments.stored_settings import (
    StoredSetting,
    StoredSettings,
    stored_number,
    stored_switch,
    stored_word,
)

Channels = Callable[[str], tuple[int, ...]]
"""Parse a channel list like `(@101:103)`, empty for the scan list; raises Refusal."""

_TRANSDUCER = "[SENSe:]TEMPerature:TRANsducer"
_OHM = stored_number(100.0, 49.0, 2100.0, exponential)
STORED: Mapping[str, StoredSetting] = {
    "[SENSe:]TEMPerature:NPLC": stored_number(1.0, 0.02, 200.0, exponential),
    f"{_TRANSDUCER}:TC:CHECk": stored_switch("0"),
    f"{_TRANSDUCER}:TC:RJUNction": stored_number(0.0, -20.0, 80.0, exponential),
    f"{_TRANSDUCER}:TC:RJUNction:TYPE": stored_word("INT", "INTernal", "EXTernal", "FIXed"),
    f"{_TRANSDUCER}:RTD:RESistance[:REFerence]": _OHM,
    f"{_TRANSDUCER}:FRTD:RESistance[:REFerence]": _OHM,
    "ROUTe:CHANnel:DELay": stored_number(0.0, 0.0, 60.0, exponential),
    "ROUTe:CHANnel:DELay:AUTO": stored_switch("1"),
}


class ChannelSettings(StoredSettings):
    """Settings of every channel."""

    def __init__(self, channels: Channels) -> None:
        super().__init__(STORED)
        self._channels = channels

    def _setter(self, header: str) -> Handler:
        def store(argument: str) -> None:
            value, _, channels = argument.partition(",")
            reported = STORED[header].reported(value.strip())
            self._values.update({(header, channel): reported for channel in self._channels(channels)})

        return store

    def _query_handler(self, header: str) -> Handler:
        def answer(argument: str) -> str:
            default = STORED[header].default
            return ",".join(self._values.get((header, channel), default) for channel in self._channels(argument))

        return answer
