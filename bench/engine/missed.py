"""Lost frames of acquisitions: detected in every block, journalled, and reported to the operator once."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from bench.config.devices import DeviceEntry
from bench.engine.context import Bench
from bench.metrology.gaps import EVENT, missed_of
from bench.metrology.missed import Missed
from bench.quality import Valid
from bench.store.decoder import decoders_of
from bench.store.reader import RunReader
from drivers.can.decoded import GapWatch
from drivers.can.frame_block import FrameBlock
from drivers.can.sorted_block import joined

LOOKED_AT_ONCE = 10_000  # frames; checking a few takes as long as checking this many


class Watch:
    """A sink that checks the sequence numbers of all frames of an acquisition.

    If the numbers are consecutive, nothing else is done. If one may be missing, the record is read back
    at the end and decoded as for the results, so that the journal agrees with them.
    """

    def __init__(self, bench: Bench, step_id: str) -> None:
        self._bench, self._step_id = bench, step_id
        self._looks: dict[str, Sequence[GapWatch]] = {}
        self._waiting: dict[str, list[FrameBlock]] = {}

    def frames(self, role: str, block: FrameBlock) -> None:
        """Check a block, together with preceding small ones."""
        if role not in self._looks:
            self._looks[role], self._waiting[role] = self._bench.numbered.of(role), []
        waiting = self._waiting[role]
        waiting.append(block)
        if sum(map(len, waiting)) >= LOOKED_AT_ONCE:
            self._look(role)

    def _look(self, role: str) -> None:
        block = joined(self._waiting[role])
        self._waiting[role] = []
        for each in self._looks[role]:
            each.take(block)

    def readings(self, role: str, readings: Sequence[Valid]) -> None:
        """Ignore readings of a meter: they have no numbers, and each is requested."""

    async def report(self) -> None:
        """Write a journal entry for each channel with lost frames, after all frames are received."""
        bench = self._bench
        for role in self._looks:
            self._look(role)
        broken = [role for role, looks in self._looks.items() if not all(each.is_whole for each in looks)]
        if not broken:
            return
        await bench.writer.commit()
        devices = {role: bench.numbered.devices[role] for role in broken}
        loop = asyncio.get_running_loop()
        found = await loop.run_in_executor(None, missed_in_step, bench.writer.folder, self._step_id, devices)
        reported = {name.partition(".")[0] for name in bench.journal.state.lost}
        for (role, channel), missed in found.items():
            bench.journal.write(EVENT, self._step_id, device=role, channel=channel, **asdict(missed))
        for role in dict.fromkeys(role for role, _ in found if role not in reported):
            of_device = {channel: missed for (device, channel), missed in found.items() if device == role}
            bench.notice(f"{self._step_id}: {_in_words(role, of_device)}")


def _in_words(role: str, missed: Mapping[str, Missed]) -> str:
    """Message for the operator, who may check the cable now; shown once in a run."""
    channels = ", ".join(
        f"{each.lost} of {each.expected} {each.what} of {channel} in {each.gaps} gap{'s' * (each.gaps > 1)}"
        for channel, each in missed.items()
    )
    return (
        f"{role}: frames are missing: {channels}. Check the cable and the termination of the bus, and the load "
        f"of this computer. This message is not repeated; the report lists every acquisition with gaps."
    )


def missed_in_step(folder: Path, step: str, devices: Mapping[str, DeviceEntry]) -> dict[tuple[str, str], Missed]:
    """Return the losses of these devices during a step, finished or not, by device and channel. Raises StoreError."""
    with RunReader(folder) as reader:
        frames = reader.frames_of(step)
    found: dict[tuple[str, str], Missed] = {}
    for role, decoder in decoders_of(devices, folder).items():
        found |= missed_of(role, decoder.outputs(frames.get(role, FrameBlock.empty())))
    return found
