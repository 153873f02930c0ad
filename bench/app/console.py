"""`bench console`: one instrument by hand, in its own protocol and through its driver, with all bytes shown."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from typing import Any

from bench.app.byhand_lines import LineProtocol, Unsendable, line_protocol_of
from bench.app.faults import laboratory_of
from bench.app.laboratory import BenchWires
from bench.app.request import load_bench_named
from bench.config.devices import DeviceEntry
from bench.errors import InputError
from bench.loop import REAL_TIME
from bench.loop import run as run_loop
from bench.rig import device_of
from bench.runner.held import address_lock
from drivers.can.dbc import Message, dbc_in
from drivers.can.frame_block import EXTENDED, FrameBlock
from drivers.can.options import FRAME_SCHEMES, DbcOptions
from drivers.capabilities import Device, FrameSource, Positioner, RateTable, Source, ThermalChamber
from drivers.errors import DriverError
from drivers.schema.suggest import did_you_mean
from drivers.transport.byhand import SharedWires
from drivers.transport.trace import RECEIVED, Passed, TracedWires
from drivers.values import ChamberState, Identity, SourceReading

Say = Callable[[str], object]
FRAMES_S = 2.0  # time for which frames are shown
BY_HAND = (
    "What you type is sent to the instrument unchanged: it may move, heat or energise something. Check the bench "
    "first. At the end the instrument is made safe if anything but queries was sent."
)
QUESTIONS_ONLY = "Only known queries are sent; --write allows all commands. :help lists what can be typed."
HELP = """\
:read      the readings of the driver
:status    the state of the instrument, as its driver sees it
:identify  maker, model and serial number
:frames    the frames of two seconds, decoded (instruments on CAN)
:safe      bring the instrument into its safe state
:help      this
:quit      end; Ctrl-D too"""


def talk(
    role: str, name: str | None, lines: Callable[[], AsyncIterator[str]], send: Say, *, simulate: bool, write: bool
) -> int:
    """Open one device of a bench and execute the lines; return the number of failed ones.

    Raises InputError for a device that the bench does not have, InUseError while another program uses it, DriverError
    when it cannot be opened or made safe.
    """
    bench = load_bench_named(name, simulate=simulate).bench
    entry = bench.devices.get(role)
    if entry is None:
        raise InputError(f"the bench has no device '{role}'{did_you_mean(role, bench.devices)}")

    # frames arrive all the time, and :frames shows them decoded
    sends_frames = entry.connection.scheme in FRAME_SCHEMES

    def keep(passed: Passed) -> None:
        if passed.sign != RECEIVED or not sends_frames:
            send(shown(passed))

    async def main() -> int:
        wires = SharedWires(TracedWires(BenchWires(bench, laboratory_of(bench)), keep))
        async with device_of(role, entry, wires, send) as device:
            console = Console(device, entry, line_protocol_of(role, entry, wires), send, write=write)
            try:
                async for line in lines():
                    if not await console.execute(line):
                        break
            finally:
                if console.wrote:
                    await device.make_safe()
                    send(f"{role} is in its safe state.")
        return console.problems

    send(BY_HAND if write else QUESTIONS_ONLY)
    with address_lock([entry.connection], f"a console of {role}"):
        return run_loop(main(), REAL_TIME)


def shown(passed: Passed) -> str:
    """Return a transfer on the wire as a line with its time."""
    return f"{passed.at_s:10.3f} {passed.sign} {passed.text}".rstrip()


class Console:
    """Console of an opened device.

    `wrote` is True if anything but a query may have been sent; `problems` counts the failed lines.
    """

    def __init__(self, device: Device, entry: DeviceEntry, protocol: LineProtocol, send: Say, *, write: bool) -> None:
        self.wrote = False
        self.problems = 0
        self._device, self._entry, self._protocol, self._say, self._write = device, entry, protocol, send, write
        self._unsure = ""  # line that must be typed again before it is sent
        self._commands: Mapping[str, Callable[[], Awaitable[None]]] = {
            ":read": self._read, ":status": self._status, ":identify": self._identify, ":frames": self._frames,
            ":safe": self._safe, ":help": self._help,
        }  # fmt: skip

    async def execute(self, typed: str) -> bool:
        """Execute one line and print its result; return False if it ends the console."""
        line = typed.strip()
        try:
            if line in (":quit", ":q"):
                return False
            if line.startswith(":") and line.split()[0].islower():
                await self._command(line)
            elif line:
                await self._type(line)
        except (DriverError, Unsendable) as problem:
            self.problems += 1
            self._say(str(problem))
        return True

    async def _command(self, line: str) -> None:
        if line not in self._commands:
            raise Unsendable(f"there is no command {line}{did_you_mean(line, self._commands)}")
        await self._commands[line]()

    async def _type(self, line: str) -> None:
        """Send a line in the instrument's protocol; with restrictions for lines that are not queries."""
        is_query = self._protocol.is_query(line)
        if is_query is not True and not self._write:
            known = "this is not a query" if is_query is False else "this protocol does not mark queries"
            raise Unsendable(f"not sent: {known}; --write allows it")
        if self._protocol.twice and not is_query and line != self._unsure:
            self._unsure = line
            self._say("not sent yet: type the same line again to send it")
            return
        self._unsure = ""
        self.wrote = self.wrote or not is_query
        for text in await self._protocol.send(line, is_question=is_query is True):
            self._say(text)

    async def _read(self) -> None:
        units = self._entry.channels
        found = await self._device.poll()
        if not any(found.values()):
            self._say(f"no new reading yet; the next one is due within {self._entry.description.reports_every_s:g} s")
        for channel, readings in found.items():
            for reading in readings[-1:]:
                self._say(f"{channel} {reading.value:.8g} {units.get(channel, '')}".rstrip())

    async def _identify(self) -> None:
        self._say(_fields(await self._device.identify()))

    async def _status(self) -> None:
        match device := self._device:
            case ThermalChamber():
                self._say(_fields(await device.state()))
            case RateTable():
                self._say(f"angle_deg {(await device.angle()).value:.8g}, rate_dps {(await device.rate()).value:.8g}")
            case Positioner():
                self._say(f"angle_deg {(await device.angle()).value:.8g}")
            case Source():
                self._say(_fields(await device.read()))
            case _:
                await self._read()

    async def _frames(self) -> None:
        if not isinstance(self._device, FrameSource):
            raise Unsendable(f"{self._device.name} sends no frames")
        async for line in decoded_frames(self._device, self._entry.options, FRAMES_S):
            self._say(line)

    async def _safe(self) -> None:
        await self._device.make_safe()
        self._say(f"{self._device.name} is in its safe state.")

    async def _help(self) -> None:
        self._say(f"{self._protocol.help}\n{HELP}")


def _fields(state: ChamberState | SourceReading | Identity) -> str:
    """Return the fields of a state that have a value, as text."""
    return ", ".join(f"{name} {value}" for name, value in state._asdict().items() if value not in ("", None))


async def decoded_frames(device: FrameSource, options: Any, for_s: float) -> AsyncIterator[str]:
    """Yield a line for each frame received within `for_s` (s), with the time since the beginning.

    Without a DBC in the options a line has the bytes only.
    """
    by_id = None
    if isinstance(options, DbcOptions):
        by_id = {message.id: message for message in dbc_in(options.dbc).messages.values()}
    loop = asyncio.get_running_loop()
    async with device.acquire(block_s=0.1) as blocks:
        began_s = loop.time()
        async for block in blocks:
            for number in range(len(block)):
                line = _line(block, number, began_s)
                yield line if by_id is None else f"{line} {_decoded(block, number, by_id)}"
            if loop.time() >= began_s + for_s:
                break


def _line(block: FrameBlock, number: int, began_s: float) -> str:
    frame, dlc = int(block.ids[number]), int(block.dlc[number])
    name = f"{frame & ~EXTENDED:08X}" if frame & EXTENDED else f"{frame:03X}"
    return f"{block.at_s[number] - began_s:10.3f} {name}#{block.data[number, :dlc].tobytes().hex().upper()}"


def _decoded(block: FrameBlock, number: int, by_id: Mapping[int, Message]) -> str:
    data, message = block.data[number].tobytes(), by_id.get(int(block.ids[number]))
    if message is None or message.length != int(block.dlc[number]):
        return "not in the DBC"
    values = (
        f"{signal.name} {signal.raw_of(data) * signal.scale + signal.offset:g} {signal.unit}".rstrip()
        for signal in message.signals.values()
    )
    return f"{message.name}: {', '.join(values)}"
