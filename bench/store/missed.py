"""Lost frames of an acquisition, from its recorded frames."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from bench.config.devices import DeviceEntry
from bench.metrology.gaps import missed_of
from bench.metrology.missed import Missed
from bench.store.decoder import decoders_of
from bench.store.reader import RunReader
from drivers.can.frame_block import FrameBlock


def missed_in_step(folder: Path, step: str, devices: Mapping[str, DeviceEntry]) -> dict[tuple[str, str], Missed]:
    """Return the losses of these devices during a step, finished or not, by device and channel. Raises StoreError."""
    with RunReader(folder) as reader:
        frames = reader.frames_of(step)
    found: dict[tuple[str, str], Missed] = {}
    for role, decoder in decoders_of(devices, folder).items():
        found |= missed_of(role, decoder.outputs(frames.get(role, FrameBlock.empty())))
    return found
