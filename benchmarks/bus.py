"""A CAN bus that sends at a fixed rate, in a process of its own: `python -m benchmarks.bus slcan --rate 8000`.

It prints its address. Like an adapter, it waits for nobody: frames that the other side has not taken when the buffer is
full are lost. A serial line gives them in portions, as an adapter with its latency timer; the server sends each frame
by itself and at once, as socketcand does. The frames are those of config/if_counter.dbc: a latch and the counts of
three axes, again and again.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import pty
import re
import socket
import subprocess
import sys
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.can.dbc import Dbc, encode_frames
from drivers.can.frame_block import FrameBlock
from drivers.transport import slcan, socketcand

DBC = Path(__file__).parents[1] / "config" / "if_counter.dbc"
FRAMES_OF_A_LATCH = 4
PULSES = {"AxisX": 3, "AxisY": 5, "AxisZ": 7}  # positive ones between two latches; there are no others
BUFFER_S = 0.25  # what an adapter keeps while nobody reads
SEND_EVERY_S = 0.005  # by a serial line
WAIT_S = 60.0  # for somebody who opens the bus


@contextlib.contextmanager
def sending(link: str, rate: float, seconds: float) -> Iterator[str]:
    """A bus in a process of its own that sends for some seconds; its address."""
    command = [sys.executable, "-m", "benchmarks.bus", link, "--rate", f"{rate}", "--seconds", f"{seconds}"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as sender:
        assert sender.stdout is not None
        try:
            yield sender.stdout.readline().strip()
        finally:
            sender.terminate()


def frames(rate: float, count: int) -> FrameBlock:
    """The first `count` frames of a counter that sends `rate` frames a second."""
    each_s = FRAMES_OF_A_LATCH / rate
    number = np.arange(-(-count // FRAMES_OF_A_LATCH))
    values = {"Latch": {"Tick": np.rint(number * each_s * 1e6).astype(np.int64), "Sequence": number}}
    for axis, pulses in PULSES.items():
        values[axis] = {"Positive": number * pulses, "Sequence": number}
    return encode_frames(Dbc(DBC.read_text("utf-8")), number * each_s, values).at(np.arange(count))


def log_of(block: FrameBlock) -> bytes:
    """The frames as candump logs them."""
    rows = zip(block.at_s.tolist(), block.ids.tolist(), block.data, strict=True)
    return b"".join(
        b"(%.6f) can0 %03X#%s\n" % (at_s, each, data.tobytes().hex().upper().encode()) for at_s, each, data in rows
    )


def slcan_line() -> tuple[str, Callable[[], int]]:
    """The address of a serial-line adapter, and what waits until its channel is open."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    name = os.ttyname(slave)

    def opened() -> int:
        heard = b""
        while b"O\r" not in heard:
            heard = (heard + os.read(master, 64))[-8:]
            os.write(master, slcan.END)
        return master

    return name, opened


def socketcand_server() -> tuple[str, Callable[[], int]]:
    """The address of a server, and what waits until its bus is open."""
    listening = socket.create_server(("127.0.0.1", 0))
    listening.settimeout(WAIT_S)

    def opened() -> int:
        connection, _ = listening.accept()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.sendall(socketcand.HI)
        for _ in ("open", "rawmode"):
            connection.recv(256)
            connection.sendall(socketcand.OK)
            time.sleep(0.05)  # python-can wants each text in a read of its own
        return connection.detach()

    return f"127.0.0.1:{listening.getsockname()[1]}", opened


def send(to: int, text: bytes, ends: NDArray[np.int64], rate: float, *, one_by_one: bool = False) -> None:
    """Send frames whose ends in the text are given, in time; what does not fit is lost, oldest first."""
    os.set_blocking(to, False)
    bounds, kept = np.concatenate(([0], ends)), int(BUFFER_S * rate)
    sent, begun, began_s = 0, b"", time.monotonic()  # `begun` is the rest of a frame
    while sent < len(ends) or begun:
        due = min(int((time.monotonic() - began_s) * rate), len(ends))
        if (late := due - sent - kept) > 0:
            sent += late
        until = min(sent + 1, due) if one_by_one else due
        waiting = begun + text[bounds[sent] : bounds[until]]
        taken = _written(to, waiting)
        if taken <= len(begun):
            begun = begun[taken:]
        else:
            end = int(bounds[sent]) + taken - len(begun)
            sent = int(np.searchsorted(bounds, end))
            begun = text[end : bounds[sent]]
        if not (one_by_one and taken and sent < due):
            time.sleep(1 / rate if one_by_one else SEND_EVERY_S)


def _written(to: int, text: bytes) -> int:
    try:
        return os.write(to, text)
    except BlockingIOError:
        return 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("link", choices=("slcan", "socketcand"))
    parser.add_argument("--rate", type=float, default=8000.0)
    parser.add_argument("--seconds", type=float, default=10.0)
    asked = parser.parse_args()
    block = frames(asked.rate, int(asked.rate * asked.seconds))
    text = slcan.render(block) if asked.link == "slcan" else socketcand.render(block, 1.7e9)
    last = slcan.END if asked.link == "slcan" else b">"
    ends = np.array([each.end() for each in re.finditer(re.escape(last), text)], np.int64)
    address, opened = slcan_line() if asked.link == "slcan" else socketcand_server()
    print(address, flush=True)
    with contextlib.suppress(ConnectionError):  # the other side has had enough
        send(opened(), text, ends, asked.rate, one_by_one=asked.link == "socketcand")


if __name__ == "__main__":
    main()
