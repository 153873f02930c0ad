"""Devices whose frames have sequence numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bench.config.devices import DeviceEntry
from bench.store.decoder import Decoder
from drivers.can.decoded import GapWatch


class Numbered:
    """Devices of a bench that number their frames, by role; their decoders are created on demand."""

    def __init__(self, devices: Mapping[str, DeviceEntry]) -> None:
        self.devices = devices
        self._decoders: dict[str, Decoder] = {}

    def of(self, role: str) -> Sequence[GapWatch]:
        """Return the gap detectors of a device for a new acquisition; none if its driver describes no frames."""
        if self.devices[role].description.frames is None:
            return ()
        if role not in self._decoders:
            self._decoders[role] = Decoder(self.devices[role])
        return self._decoders[role].watches()
