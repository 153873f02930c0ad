from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulators.instruments.modbus import ExceptionCode, ModbusServer, ModbusTcpSession, RegisterError

READ = bytes.fromhex("00 01 00 00 00 06 11 03 00 6b 00 03")
READ_ANSWER = bytes.fromhex("00 01 00 00 00 09 11 03 06 00 6b 00 6c 00 6d")
WRITE_ONE = bytes.fromhex("00 02 00 00 00 06 11 06 00 01 00 03")
WRITE_MANY = bytes.fromhex("00 03 00 00 00 0b 11 10 00 01 00 02 04 00 0a 01 02")
WRITE_MANY_ANSWER = bytes.fromhex("00 03 00 00 00 06 11 10 00 01 00 02")


class Memory:
    """Every register holds its own address until it is written; those from 1000 on refuse."""

    def __init__(self) -> None:
        self.written: list[tuple[int, tuple[int, ...]]] = []

    def read(self, address: int, count: int) -> Sequence[int]:
        if address >= 1000:
            raise RegisterError(ExceptionCode(address - 999))
        return range(address, address + count)

    def write(self, address: int, words: Sequence[int]) -> None:
        if address >= 1000:
            raise RegisterError(ExceptionCode(address - 999))
        self.written.append((address, tuple(words)))


@pytest.fixture
def memory() -> Memory:
    return Memory()


@pytest.fixture
def session(memory: Memory) -> ModbusTcpSession:
    return ModbusTcpSession(ModbusServer(memory, unit_id=0x11))


def test_registers_are_read(session: ModbusTcpSession) -> None:
    assert session.feed(READ) == READ_ANSWER


def test_registers_are_written(session: ModbusTcpSession, memory: Memory) -> None:
    assert session.feed(WRITE_ONE) == WRITE_ONE
    assert session.feed(WRITE_MANY) == WRITE_MANY_ANSWER
    assert memory.written == [(1, (3,)), (1, (10, 258))]


@given(st.lists(st.integers(1, 40), max_size=20))
def test_requests_are_answered_however_they_are_cut(sizes: list[int]) -> None:
    stream, answers = READ + WRITE_ONE + WRITE_MANY, b""
    session = ModbusTcpSession(ModbusServer(Memory(), unit_id=0x11))
    for size in [*sizes, len(stream)]:
        answers += session.feed(stream[:size])
        stream = stream[size:]
    assert answers == READ_ANSWER + WRITE_ONE + WRITE_MANY_ANSWER


def test_nothing_is_said_to_a_request_for_another_unit(session: ModbusTcpSession, memory: Memory) -> None:
    assert session.feed(WRITE_ONE.replace(b"\x11", b"\x12") + READ) == READ_ANSWER
    assert memory.written == []


@pytest.mark.parametrize(
    "garbage",
    [
        "00 01 00 01 00 06 11 03 00 6b 00 03",  # not protocol 0
        "00 01 00 00 00 01 11 03 00 6b 00 03",  # no room for a function
        "00 01 00 00 01 00 11 03 00 6b 00 03",  # longer than a request can be
    ],
)
def test_bytes_that_are_no_request_are_dropped_with_what_is_behind_them(
    session: ModbusTcpSession, garbage: str
) -> None:
    assert session.feed(bytes.fromhex(garbage)) == b""
    assert session.feed(READ) == READ_ANSWER


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("11 2b 0e 01 00", "11 ab 01"),  # a function that is not served
        ("11 04 00 00 00 01", "11 84 01"),
        ("11 03 ff ff 00 02", "11 83 02"),  # beyond the last address
        ("11 10 ff ff 00 02 04 00 01 00 02", "11 90 02"),
        ("11 03 00 00 00 00", "11 83 03"),  # no registers
        ("11 03 00 00 00 7e", "11 83 03"),  # 126 of them
        ("11 03 00 00", "11 83 03"),  # half a request
        ("11 06 00 00 00 01 02", "11 86 03"),  # too much of one
        ("11 10 00 00 00 00 00", "11 90 03"),
        ("11 10 00 00 00 7c f8", "11 90 03"),  # 124 registers
        ("11 10 00 00 00 02 02 00 01", "11 90 03"),  # byte count of one register
        ("11 10 00 00 00 02 04 00 01", "11 90 03"),  # a register is missing
        ("11 10 00 00 00 02", "11 90 03"),  # no byte count
        ("11 03 03 e8 00 01", "11 83 01"),  # the codes of the registers themselves
        ("11 06 03 e9 00 01", "11 86 02"),
        ("11 10 03 ea 00 01 02 00 01", "11 90 03"),
        ("11 03 03 eb 00 01", "11 83 04"),
    ],
)
def test_a_refusal_carries_its_code(session: ModbusTcpSession, request_: str, answer: str) -> None:
    pdu = bytes.fromhex(request_)
    message = session.feed(b"\x12\x34\x00\x00" + len(pdu).to_bytes(2, "big") + pdu)
    assert message.hex(" ") == f"12 34 00 00 00 03 {answer}"


@pytest.mark.parametrize(("count", "answered"), [(125, True), (126, False)])
def test_at_most_125_registers_are_read_at_once(session: ModbusTcpSession, count: int, answered: bool) -> None:
    message = session.feed(READ[:-2] + count.to_bytes(2, "big"))
    assert (len(message) == 9 + 2 * count) is answered


def test_the_longest_write_fits(session: ModbusTcpSession, memory: Memory) -> None:
    words = bytes(2 * 123)
    message = session.feed(bytes.fromhex("00 01 00 00 00 fd 11 10 00 01 00 7b f6") + words)
    assert message.hex(" ") == "00 01 00 00 00 06 11 10 00 01 00 7b"
    assert memory.written == [(1, (0,) * 123)]
