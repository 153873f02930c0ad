"""The bus that sends at a fixed rate: what is not taken is lost as whole frames."""

from __future__ import annotations

import os
import pty
import re
import threading
import tty

import numpy as np
import pytest

from benchmarks import bus
from drivers.transport import slcan
from drivers.transport.alike import Arrivals

pytestmark = pytest.mark.integration

RATE, COUNT = 1e6, 40_000
BLOCK = bus.frames(RATE, COUNT)
TEXT = slcan.render(BLOCK)
ENDS = np.array([each.end() for each in re.finditer(b"\r", TEXT)], np.int64)


@pytest.mark.parametrize("buffer_s", [1e9, 0.001])
def test_frames_arrive_whole_and_in_order(buffer_s: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bus, "BUFFER_S", buffer_s)
    monkeypatch.setattr(bus, "SEND_EVERY_S", 0.0)
    master, slave = pty.openpty()
    tty.setraw(slave)
    sender = threading.Thread(target=bus.send, args=(master, TEXT, ENDS, RATE))
    sender.start()
    os.set_blocking(slave, False)
    heard = b""
    while True:
        over = not sender.is_alive()
        try:
            heard += os.read(slave, 65536)
        except BlockingIOError:
            if over:
                break
    sender.join()
    os.close(master)
    os.close(slave)
    block, rest, junk = slcan.parse(heard, Arrivals.at_once(0.0))
    assert (rest, junk) == (b"", 0)
    assert set(block.ids.tolist()) <= {0x100, 0x101, 0x102, 0x103}
    sent = {row.tobytes(): at for at, row in enumerate(BLOCK.data[BLOCK.ids == 0x100])}
    found = [sent[row.tobytes()] for row in block.data[block.ids == 0x100]]
    assert found == sorted(found)
    assert len(block) == COUNT or buffer_s < 1


def test_a_server_sends_each_frame_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[bytes] = []

    def written(to: int, text: bytes) -> int:
        sent.append(text)
        return len(text)

    monkeypatch.setattr(bus, "_written", written)
    some = ENDS[:50]
    with open(os.devnull, "wb") as nobody:
        bus.send(nobody.fileno(), TEXT, some, 10_000.0, one_by_one=True)
    assert [text for text in sent if text] == [line + b"\r" for line in TEXT[: some[-1]].split(b"\r")[:-1]]
