"""Modbus on a serial line: frames typed from the register lists of chambers, both ends, and what a bad line does."""

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

import pytest

from bench.loop import AS_FAST_AS_POSSIBLE, BenchLoop, run
from drivers.errors import BadAnswer, LinkLost, NoAnswer, Refused
from drivers.transport.address import Address
from drivers.transport.memory import Line
from drivers.transport.modbus import ModbusLink
from drivers.transport.wires import RealWires
from simulators.instruments.modbus import ExceptionCode, ModbusRtuSession, ModbusServer, RegisterError, crc16

READ_100 = bytes.fromhex("01 03 00 64 00 01 c5 d5")
ANSWER_25_3_C = bytes.fromhex("01 03 02 00 fd 79 c5")
WRITE_300 = bytes.fromhex("01 06 01 2c fe 70 08 7b")
REFUSED = bytes.fromhex("01 83 02 c0 f1")
READ_11A9 = bytes.fromhex("01 03 11 a9 00 02 11 17")
ANSWER_23_5_C = bytes.fromhex("01 03 04 00 00 41 bc cb d2")
WRITE_1581 = bytes.fromhex("01 10 15 81 00 02 04 00 00 42 20 f9 eb")
WRITE_1A22 = bytes.fromhex("01 06 1a 22 08 00 29 18")
ADDRESS = Address.parse("socket://127.0.0.1:4001")

Script = Callable[[bytes], Sequence[tuple[float, bytes]]]


class Memory:
    """Registers that keep what is written."""

    def __init__(self) -> None:
        self.words = {100: 0x00FD, 300: 250, 0x11A9: 0, 0x11AA: 0x41BC, 0x1581: 0, 0x1582: 0, 0x1A22: 0}

    def read(self, address: int, count: int) -> Sequence[int]:
        if any(address + offset not in self.words for offset in range(count)):
            raise RegisterError(ExceptionCode.ILLEGAL_ADDRESS)
        return [self.words[address + offset] for offset in range(count)]

    def write(self, address: int, words: Sequence[int]) -> None:
        self.words.update({address + offset: word for offset, word in enumerate(words)})


def a_session(memory: Memory | None = None) -> ModbusRtuSession:
    return ModbusRtuSession(ModbusServer(memory or Memory(), unit_id=1), lambda: 0.0)


# The simulated end


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        (READ_100, ANSWER_25_3_C),
        (READ_11A9, ANSWER_23_5_C),
        (WRITE_300, WRITE_300),
        (WRITE_1A22, WRITE_1A22),
        (WRITE_1581, bytes.fromhex("01 10 15 81 00 02 15 ec")),
        (bytes.fromhex("01 03 00 65 00 01 94 15"), REFUSED),
    ],
)
def test_a_server_answers_the_frames_of_the_register_lists(request_: bytes, answer: bytes) -> None:
    assert a_session().feed(request_) == answer


def test_a_request_may_come_in_any_portions() -> None:
    for cut in range(1, len(WRITE_1581)):
        memory = Memory()
        session = a_session(memory)
        assert session.feed(WRITE_1581[:cut]) == b""
        assert session.feed(WRITE_1581[cut:]) != b""
        assert [memory.words[0x1581], memory.words[0x1582]] == [0x0000, 0x4220]


def test_a_flipped_bit_gets_no_answer_and_changes_nothing() -> None:
    for bit in range(8 * len(WRITE_300)):
        memory = Memory()
        flipped = bytearray(WRITE_300)
        flipped[bit // 8] ^= 1 << bit % 8
        assert a_session(memory).feed(bytes(flipped)) == b""
        assert memory.words == Memory().words


def test_another_unit_is_not_answered_for() -> None:
    other = b"\x02" + READ_100[1:-2]
    assert a_session().feed(other + crc16(other).to_bytes(2, "little")) == b""


def test_what_stood_on_the_line_for_long_is_no_part_of_a_frame() -> None:
    now_s = [0.0]
    session = ModbusRtuSession(ModbusServer(Memory(), unit_id=1), lambda: now_s[0])
    assert session.feed(READ_100[:3]) == b""
    now_s[0] = 1.0
    assert session.feed(READ_100) == ANSWER_25_3_C


# The driver's end


class Server(asyncio.Protocol):
    def __init__(self, script: Script, requests: list[tuple[float, bytes]]) -> None:
        self.script, self.requests = script, requests

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        loop = asyncio.get_running_loop()
        self.requests.append((loop.time(), data))
        for delay_s, answer in self.script(data):
            loop.call_later(delay_s, self.transport.write, answer)


class Wired:
    def __init__(self, script: Script) -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, BenchLoop)
        self.requests: list[tuple[float, bytes]] = []
        loop.serve_in_memory(ADDRESS.host, ADDRESS.port, lambda: Server(script, self.requests), Line(latency_s=0.004))
        self.link = ModbusLink("chamber", RealWires(), ADDRESS, unit_id=1, answer_s=3.0)


def with_server(script: Script, use: Callable[[Wired], Coroutine[Any, Any, None]]) -> None:
    async def main() -> None:
        wired = Wired(script)
        await wired.link.open()
        await use(wired)
        wired.link.close()

    run(main(), AS_FAST_AS_POSSIBLE)


ANSWERS = {
    READ_100: ANSWER_25_3_C, READ_11A9: ANSWER_23_5_C, WRITE_300: WRITE_300, WRITE_1A22: WRITE_1A22,
    WRITE_1581: bytes.fromhex("01 10 15 81 00 02 15 ec"),
}  # fmt: skip


def test_what_it_sends_and_understands_is_what_the_register_lists_say() -> None:
    async def use(wired: Wired) -> None:
        link = wired.link
        assert await link.read(100, 1) == (0x00FD,)
        assert await link.read(0x11A9, 2) == (0x0000, 0x41BC)
        await link.write(300, (0xFE70,))
        await link.write(0x1581, (0x0000, 0x4220))
        await link.write(0x1A22, (0x0800,))
        assert [request for _, request in wired.requests] == [READ_100, READ_11A9, WRITE_300, WRITE_1581, WRITE_1A22]
        gaps_s = [after - before for (before, _), (after, _) in zip(wired.requests, wired.requests[1:], strict=False)]
        assert min(gaps_s) >= 0.03

    with_server(lambda request: [(0.0, ANSWERS[request])], use)


def test_input_registers_are_read_by_function_4() -> None:
    asked = bytes.fromhex("01 04 00 64 00 01 70 15")

    async def use(wired: Wired) -> None:
        assert await wired.link.read(100, 1, function=4) == (0x00FD,)
        assert wired.requests[0][1] == asked

    with_server(lambda _request: [(0.0, bytes.fromhex("01 04 02 00 fd 78 b1"))], use)


def test_a_refusal_keeps_the_connection() -> None:
    async def use(wired: Wired) -> None:
        with pytest.raises(Refused, match="Modbus exception 2, no such register; sent read 1 register at 100"):
            await wired.link.read(100, 1)
        assert wired.link.is_open

    with_server(lambda _request: [(0.0, REFUSED)], use)


@pytest.mark.parametrize("bit", range(8 * len(ANSWER_25_3_C)))
def test_a_flipped_bit_never_becomes_a_value(bit: int) -> None:
    flipped = bytearray(ANSWER_25_3_C)
    flipped[bit // 8] ^= 1 << bit % 8

    async def use(wired: Wired) -> None:
        with pytest.raises((BadAnswer, NoAnswer)):
            await wired.link.read(100, 1)
        assert not wired.link.is_open

    with_server(lambda _request: [(0.0, bytes(flipped))], use)


@pytest.mark.parametrize(
    ("answer", "problem"),
    [
        (ANSWER_25_3_C + b"\x00", "more than one frame"),
        (ANSWER_25_3_C + ANSWER_25_3_C, "more than one frame"),
        (READ_100, "wrong checksum"),  # an echo: its third byte promises no data
        (bytes.fromhex("02 03 02 00 fd 7d 81"), "from unit 2 instead of 1"),
        (bytes.fromhex("01 04 02 00 fd 78 b1"), "function 4 instead of 3"),
        (bytes.fromhex("01 03 04 00 00 41 bc cb d2"), "2 registers"),
    ],
)
def test_what_is_no_answer_to_the_request_is_told_and_ends_the_trust(answer: bytes, problem: str) -> None:
    async def use(wired: Wired) -> None:
        with pytest.raises(BadAnswer, match=problem):
            await wired.link.read(100, 1)
        with pytest.raises(LinkLost):
            await wired.link.read(100, 1)

    with_server(lambda _request: [(0.0, answer)], use)


def test_what_is_said_unasked_is_told_before_the_next_request_goes_out() -> None:
    async def use(wired: Wired) -> None:
        assert await wired.link.read(100, 1) == (0x00FD,)
        await asyncio.sleep(1.0)
        with pytest.raises(BadAnswer, match="01 03 02 00 fd 79 c5 before the request"):
            await wired.link.read(100, 1)
        assert len(wired.requests) == 1

    with_server(lambda _request: [(0.0, ANSWER_25_3_C), (0.5, ANSWER_25_3_C)], use)


def test_a_late_answer_is_drained_when_the_line_is_opened_again() -> None:
    late = [[(3.2, ANSWER_25_3_C)], [(0.0, bytes.fromhex("01 03 02 00 fa 38 07"))]]

    async def use(wired: Wired) -> None:
        with pytest.raises(NoAnswer, match=r"no answer within 3 s from socket://127\.0\.0\.1:4001"):
            await wired.link.read(100, 1)
        await wired.link.open()
        assert await wired.link.read(100, 1) == (250,)

    with_server(lambda _request: late.pop(0), use)


def test_a_line_that_is_never_silent_is_told() -> None:
    class Talker(asyncio.Protocol):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            assert isinstance(transport, asyncio.Transport)
            transport.write(b"\x00")
            if not transport.is_closing():
                asyncio.get_running_loop().call_later(0.2, self.connection_made, transport)

    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, BenchLoop)
        loop.serve_in_memory(ADDRESS.host, ADDRESS.port, Talker, Line(latency_s=0.004))
        link = ModbusLink("chamber", RealWires(), ADDRESS, unit_id=1)
        with pytest.raises(BadAnswer, match="is not silent within 5 s"):
            await link.open()
        assert not link.is_open

    run(main(), AS_FAST_AS_POSSIBLE)
