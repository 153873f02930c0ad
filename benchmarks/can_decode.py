"""Our block decoder beside cantools, on the same frames in the same process: `make benchmark`."""

from __future__ import annotations

import time
from pathlib import Path

import cantools
import numpy as np

from drivers.can.dbc import Dbc
from drivers.can.frame_block import FrameBlock

DBC = Path(__file__).parents[1] / "config" / "if_counter.dbc"
REPEATS = 5


def best(work) -> float:
    times = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times)


def main() -> None:
    text = DBC.read_text("utf-8")
    ours, theirs = Dbc(text), cantools.database.load_string(text, "dbc")
    draws = np.random.default_rng(1)
    print(f"{'frames in a block':>18} {'ours µs/frame':>14} {'cantools':>10} {'ratio':>7}")
    for count in (40, 400, 4000):
        ids = np.tile(np.array([0x100, 0x101, 0x102, 0x103], np.uint32), count // 4)
        data = draws.integers(0, 256, (count, 8)).astype(np.uint8)
        block = FrameBlock(ids, np.zeros(count), np.full(count, 8, np.uint8), data)
        rows = list(zip(ids.tolist(), [row.tobytes() for row in data], strict=True))

        def decode_ours(block=block):
            for message in ours.messages.values():
                chosen = block.data[message.rows(block)]
                for signal in message.signals.values():
                    signal.raw(chosen)

        def decode_theirs(rows=rows):
            for frame_id, payload in rows:
                theirs.decode_message(frame_id, payload, decode_choices=False, scaling=False)

        mine, peer = best(decode_ours) / count * 1e6, best(decode_theirs) / count * 1e6
        print(f"{count:>18} {mine:>14.2f} {peer:>10.2f} {peer / mine:>6.0f}x")


if __name__ == "__main__":
    main()
