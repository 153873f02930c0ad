"""What did not come of an acquisition, by the frames of it that were recorded."""

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
    """What did not come of these devices during a step of a run, finished or not, by device and channel; StoreError."""
    with RunReader(folder) as reader:
        frames = reader.frames_of(step)
    found: dict[tuple[str, str], Missed] = {}
    for role, decoder in decoders_of(devices, folder).items():
        found |= missed_of(role, decoder.outputs(frames.get(role, FrameBlock.empty())))
    return found
