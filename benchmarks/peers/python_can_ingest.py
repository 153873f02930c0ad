"""Frames of a counter with python-can and cantools: its Notifier, its SQLite writer, each message decoded.

python python_can_ingest.py LINK ADDRESS SECONDS DBC
"""

import json
import logging
import sys
import tempfile
import threading
import time
from itertools import pairwise
from pathlib import Path

import can
import cantools

logging.disable(logging.CRITICAL)


class Counts(can.Listener):
    """Decodes each frame and keeps its numbers, by message."""

    def __init__(self, database):
        self._database, self.frames, self.found = database, 0, {}

    def on_message_received(self, message):
        signals = self._database.decode_message(
            message.arbitration_id, message.data, decode_choices=False, scaling=False
        )
        self.found.setdefault(message.arbitration_id, []).append(tuple(signals.values()))
        self.frames += 1


def opened(link, address):
    if link == "slcan":
        return can.Bus(interface="slcan", channel=address, bitrate=1_000_000, sleep_after_open=0)
    host, _, port = address.rpartition(":")
    return can.Bus(interface="socketcand", host=host, port=int(port), channel="can0")


def main():
    link, address, seconds, dbc = sys.argv[1], sys.argv[2], float(sys.argv[3]), sys.argv[4]
    counts = Counts(cantools.database.load_file(dbc))
    with tempfile.TemporaryDirectory() as folder:
        began_s = time.process_time()
        writer = can.SqliteWriter(Path(folder) / "frames.db")
        if link == "log":
            with can.LogReader(address) as reader:
                first_s = None
                for message in reader:
                    first_s = message.timestamp if first_s is None else first_s
                    if message.timestamp - first_s >= seconds:
                        break
                    writer(message)
                    counts(message)
        else:
            bus = opened(link, address)
            notifier = can.Notifier(bus, [writer, counts])
            threading.Event().wait(seconds)
            notifier.stop()
            bus.shutdown()
        writer.stop()
        cpu_s = time.process_time() - began_s
    latches = [numbers[1] for numbers in counts.found[0x100]]
    gaps = sum((after - before - 1) % 65536 for before, after in pairwise(latches))
    print(json.dumps({"cpu_s": cpu_s, "frames": counts.frames, "gaps": gaps}))


if __name__ == "__main__":
    main()
