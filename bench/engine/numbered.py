"""Devices whose frames have sequence numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bench.config.devices import DeviceEntry
from bench.store.decoder import Decoder
from drivers.can.decoded import GapWatch


class Numbered:
    """The devices of a bench whose frames have numbers, by role; their decoders are made when they are needed."""

    def __init__(self, devices: Mapping[str, DeviceEntry]) -> None:
        self.devices = devices
        self._decoders: dict[str, Decoder] = {}

    def of(self, role: str) -> Sequence[GapWatch]:
        """Watches of a device for a new acquisition; none if its driver describes no frames."""
        if self.devices[role].description.frames is None:
            return ()
        if role not in self._decoders:
            self._decoders[role] = Decoder(self.devices[role])
        return self._decoders[role].watches()
