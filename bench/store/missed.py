"""What did not come of an acquisition, by the frames of it that were recorded."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from bench.metrology.gaps import missed_of
from bench.metrology.missed import Missed
from bench.store.codes import CodeDecoder
from bench.store.counts import CountDecoder
from bench.store.reader import RunReader
from drivers.can.frame_block import FrameBlock
from drivers.dialects.can_counter.description import CounterOptions
from drivers.dialects.can_telemetry.description import TelemetryOptions


def missed_in_step(
    folder: Path, step: str, devices: Mapping[str, CounterOptions | TelemetryOptions]
) -> dict[tuple[str, str], Missed]:
    """What did not come of these devices during a step of a run, finished or not, by device and channel; StoreError."""
    with RunReader(folder) as reader:
        frames = reader.frames_of(step)
    found: dict[tuple[str, str], Missed] = {}
    for role, options in devices.items():
        block = frames.get(role, FrameBlock.empty())
        decoded = (
            CodeDecoder(options, folder).codes(block)
            if isinstance(options, TelemetryOptions)
            else CountDecoder(options, folder).counts(block)
        )
        found |= missed_of(role, decoded)
    return found
