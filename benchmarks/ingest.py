"""Frames of a counter from their bytes into a run, and from there into counts.

    python -m benchmarks.ingest ADDRESS SECONDS RATE

The driver, the run store and the decoder are those of a run, with one device. It prints a line of JSON.
"""

from __future__ import annotations

import asyncio
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from bench.config.devices import DeviceEntry
from bench.config.load import load_file
from bench.config.models import BenchFile
from bench.engine.outputs import acquire_into
from bench.loop import AS_FAST_AS_POSSIBLE, REAL_TIME, run
from bench.metrology.acquisition import Counts
from bench.quality import Valid
from bench.rig import Rig, device_of
from bench.store.decoder import Decoder
from bench.store.reader import RunReader
from bench.store.runs import MANIFEST
from bench.store.writer import RunWriter
from benchmarks.bus import FRAMES_OF_A_LATCH
from drivers.can.frame_block import FrameBlock
from drivers.transport import can as _can  # noqa: F401  is loaded before the time is taken
from drivers.transport import socketcand as _socketcand  # noqa: F401  as is that of the other side
from drivers.transport.wires import RealWires

CONFIG = Path(__file__).parents[1] / "config"
STEP = "acquire"


class Recorded:
    """Writes blocks to the run and watches for gaps, as a step of a run does."""

    def __init__(self, writer: RunWriter, decoder: Decoder) -> None:
        self._writer, self._watches = writer, decoder.watches()

    def frames(self, role: str, block: FrameBlock) -> None:
        self._writer.frames(role, STEP, block)
        for each in self._watches:
            each.take(block)

    def readings(self, role: str, readings: Sequence[Valid]) -> None:
        raise TypeError("a counter gives frames")


async def record(entry: DeviceEntry, folder: Path, seconds: float) -> None:
    """Record the frames of some seconds; they are on the disk when it returns."""
    writer = RunWriter(folder, noted=False)
    recorded = Recorded(writer, Decoder(entry))
    async with Rig({"counter": device_of("counter", entry, RealWires())}) as rig:
        await acquire_into(["counter"], rig, [recorded], asyncio.sleep(seconds))
    await writer.commit()
    writer.close()


def counts_in(entry: DeviceEntry, folder: Path) -> tuple[int, dict[str, Counts]]:
    """Number of frames in a run, and their counts."""
    with RunReader(folder) as reader:
        block = reader.frames_of(STEP)["counter"]
    found = Decoder(entry).outputs(block)
    return len(block), {name: each for name, each in found.items() if isinstance(each, Counts)}


def bench_with(folder: Path, address: str, period_s: float) -> BenchFile:
    """The simulated bench with a real connection of its counter."""
    shutil.copytree(CONFIG, folder / "config")
    bench = folder / "config" / "simulated.yaml"
    text = bench.read_text("utf-8").replace("sim+slcan:///tmp/itb/can?bitrate=500000", address)
    bench.write_text(text.replace("period: 100 ms", f"period: {period_s * 1e6:g} us"), "utf-8")
    return load_file(bench, BenchFile)


def main() -> None:
    address, seconds, rate = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
    speed = AS_FAST_AS_POSSIBLE if address.startswith("log:") else REAL_TIME
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        entry = bench_with(folder, address, FRAMES_OF_A_LATCH / rate).devices["counter"]
        Decoder(entry)  # cantools is imported
        (folder / "run").mkdir()
        (folder / "run" / MANIFEST).write_text('{"state": "running", "run": "ingest", "units": []}', "utf-8")
        began_s = time.process_time()
        run(record(entry, folder / "run", seconds), speed)
        frames, counts = counts_in(entry, folder / "run")
        cpu_s = time.process_time() - began_s
    gaps = max(each.lost for each in counts.values())
    pulses = {name: int(each.positive[-1]) - int(each.positive[0]) for name, each in counts.items()}
    print(json.dumps({"cpu_s": cpu_s, "frames": frames, "gaps": gaps, "pulses": pulses}))


if __name__ == "__main__":
    main()
