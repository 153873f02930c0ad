"""The loop that one writes: once a second a chamber by pymodbus and counts by pyserial, timed by the host's clock.

    python host_clock_loop.py SERIAL_LINE CHAMBER_PORT GATES

The counts are those of the newest frame at the end of a second and of the one before, their times those at which the
host read them.
"""

import asyncio
import json
import sys
import time

import serial
from pymodbus.client import AsyncModbusTcpClient

AXIS_X, WHOLE = b"t101", 22  # a frame of the axis, and its characters
GATE_S = 1.0
PROCESS_VALUE, UNIT = 2820, 1


class Counter:
    """A counter behind a serial-line adapter: `newest` is the time and the count of its last frame."""

    def __init__(self, name):
        self._port, self._rest, self.newest = serial.Serial(name, timeout=0), b"", (0.0, 0)
        asyncio.get_running_loop().add_reader(self._port.fileno(), self._read)
        self._port.write(b"C\rS8\rO\r")

    def _read(self):
        *lines, self._rest = (self._rest + self._port.read(65536)).split(b"\r")
        read_s = time.monotonic()
        for line in lines:
            if line.startswith(AXIS_X) and len(line) == WHOLE - 1:
                self.newest = read_s, int.from_bytes(bytes.fromhex(line[5:11].decode()), "little")


async def main():
    chamber = AsyncModbusTcpClient("127.0.0.1", port=int(sys.argv[2]))
    if not await chamber.connect():
        raise ConnectionError("the chamber does not accept a connection")
    counter, rates, gates_s, temperatures = Counter(sys.argv[1]), [], [], []
    await asyncio.sleep(GATE_S)  # the first frames arrive
    due_s = time.monotonic() + GATE_S
    (before_s, before), woken_s = counter.newest, time.monotonic()
    for _ in range(int(sys.argv[3])):
        await asyncio.sleep(due_s - time.monotonic())
        now_s, (read_s, count) = time.monotonic(), counter.newest
        rates.append((count - before) / (read_s - before_s))
        gates_s.append(now_s - woken_s)
        before_s, before, woken_s, due_s = read_s, count, now_s, due_s + GATE_S
        temperatures.append((await chamber.read_holding_registers(PROCESS_VALUE, count=2, device_id=UNIT)).registers)
    chamber.close()
    print(json.dumps({"rates": rates, "gates_s": gates_s}))


asyncio.run(main())
