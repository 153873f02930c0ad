"""Context in which a step of a plan acts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from bench.config.devices import DeviceEntry
from bench.config.models import BenchFile
from bench.engine.crediting import SoakCredit
from bench.engine.journal import Journal
from bench.engine.monitor import Monitor
from bench.engine.orders import Orders
from bench.engine.questions import PromptQueue
from bench.rig import Rig
from bench.store.decoder import Decoder
from bench.store.writer import RunWriter
from drivers.can.decoded import GapWatch

Found = Mapping[str, Any]  # result of a step, for the journal


@dataclass(frozen=True)
class Bench:
    """Context of a step: rig, plan and services.

    `angles_deg` are the targets of the last moves by role, `numbered` are the devices that number their frames,
    `credit` is that of a soak of a resumed run, `role` is the one that a plug-in's step names, `orders` are those of
    manual control.
    """

    file: BenchFile
    rig: Rig
    monitor: Monitor
    journal: Journal
    prompts: PromptQueue
    notice: Callable[[str], None]
    numbered: Numbered
    angles_deg: dict[str, float] = field(default_factory=dict)
    credit: SoakCredit | None = None
    role: str | None = None
    orders: Orders = field(default_factory=Orders)

    @property
    def writer(self) -> RunWriter:
        """Writer of the record of the run."""
        return self.journal.writer


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
