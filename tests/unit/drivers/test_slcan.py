import asyncio
from collections.abc import Awaitable, Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.can.frame_block import EXTENDED, FrameBlock
from drivers.errors import CannotConnect, LinkLost
from drivers.transport import slcan
from drivers.transport.address import Address
from drivers.transport.alike import Arrivals
from drivers.transport.can import Slcan, open_slcan
from drivers.transport.frame_link import FrameLink
from drivers.transport.memory import Line, join
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.can_nodes.can_counter import SimulatedCounter
from simulators.instruments.can_nodes.slcan_adapter import UNREAD_LIMIT_BYTES, SimulatedAdapter
from simulators.units.settings import WorldSettings
from simulators.world import World
from tests.support.laboratory import a_counter

LINES = b"t1008A08601000500002A\rt1016010203040506\rT1ABCDEF02ffEE\rt7FF0\r"


def rows(block: FrameBlock) -> list[tuple[int, int, str]]:
    return [
        (int(frame_id), int(dlc), data[:dlc].tobytes().hex())
        for frame_id, dlc, data in zip(block.ids, block.dlc, block.data, strict=True)
    ]


FRAMES = [
    (0x100, 8, "a08601000500002a"),
    (0x101, 6, "010203040506"),
    (0x1ABCDEF0 | EXTENDED, 2, "ffee"),
    (0x7FF, 0, ""),
]


# Lines into frames


def test_lines_are_frames() -> None:
    block, rest, junk = slcan.parse(LINES, Arrivals.at_once(12.5))
    assert rows(block) == FRAMES
    assert (rest, junk) == (b"", 0)
    assert block.at_s.tolist() == [12.5] * 4
    assert block.data[1].tolist() == [1, 2, 3, 4, 5, 6, 0, 0], "zero past the end of the frame"


@pytest.mark.parametrize("cut", range(len(LINES) + 1))
def test_lines_may_be_cut_at_every_byte(cut: int) -> None:
    first, rest, junk = slcan.parse(LINES[:cut], Arrivals.at_once(0.0))
    second, end, more_junk = slcan.parse(rest + LINES[cut:], Arrivals.at_once(1.0))
    assert rows(first) + rows(second) == FRAMES
    assert (end, junk, more_junk) == (b"", 0, 0)
    assert len(first) == LINES[:cut].count(b"\r")


def test_a_byte_at_a_time() -> None:
    rest, found = b"", []
    for byte in LINES:
        block, rest, junk = slcan.parse(rest + bytes([byte]), Arrivals.at_once(0.0))
        found += rows(block)
        assert junk == 0
    assert found == FRAMES


@pytest.mark.parametrize(
    "line",
    [
        b"t", b"t10", b"t1008", b"t100811", b"t100211223", b"t10021122334", b"t1009112233445566778899", b"t10G0",
        b"t100211G2", b"x1000", b"t8000", b"tFFF0", b"T200000000", b"T8000010081122334455667788", b"T1FFFFFF", b"r1000",
        b"V1013", b"F00", b"\x00\xff\x80", b"t1002112\xff",
    ],
)  # fmt: skip
def test_a_line_that_is_no_frame_is_counted_and_harms_no_other(line: bytes) -> None:
    block, rest, junk = slcan.parse(LINES + line + b"\r" + LINES, Arrivals.at_once(0.0))
    assert rows(block) == FRAMES * 2
    assert (rest, junk) == (b"", 1)


def test_acknowledgements_are_neither_frames_nor_errors() -> None:
    block, rest, junk = slcan.parse(b"\r\r\az\rZ\r\a" + LINES + b"z\r\a\a\r", Arrivals.at_once(0.0))
    assert rows(block) == FRAMES
    assert (rest, junk) == (b"", 0)


def test_nothing_is_nothing() -> None:
    for data in (b"", b"t10"):
        block, rest, junk = slcan.parse(data, Arrivals.at_once(0.0))
        assert (len(block), rest, junk) == (0, data, 0)


@given(st.binary(max_size=200))
def test_no_bytes_whatever_are_an_error(data: bytes) -> None:
    block, rest, junk = slcan.parse(data, Arrivals.at_once(0.0))
    assert len(block) + junk <= data.count(b"\r") + data.count(b"\a")
    assert b"\r" not in rest
    assert rest == b"" or (data.endswith(rest))


FRAME = st.tuples(
    st.one_of(st.integers(0, 0x7FF), st.integers(0, 0x1FFFFFFF).map(lambda n: n | EXTENDED)), st.binary(max_size=8)
)


@given(st.lists(FRAME, max_size=30), st.lists(st.integers(0, 600), max_size=5))
def test_what_an_adapter_renders_is_read_back_in_order(frames: list[tuple[int, bytes]], cuts: list[int]) -> None:
    block = FrameBlock(
        np.array([frame_id for frame_id, _ in frames], np.uint32), np.zeros(len(frames)),
        np.array([len(data) for _, data in frames], np.uint8),
        np.array([list(data.ljust(8, b"\0")) for _, data in frames], np.uint8).reshape(-1, 8),
    )  # fmt: skip
    text = slcan.render(block)
    found, rest, begin = [], b"", 0
    for cut in [*sorted(cuts), len(text)]:
        part, rest, junk = slcan.parse(rest + text[begin:cut], Arrivals.at_once(0.0))
        found += rows(part)
        begin = max(begin, cut)
        assert junk == 0
    assert found == rows(block)


def test_frames_are_rendered_as_an_adapter_sends_them() -> None:
    block = FrameBlock(
        np.array([0x100, 0x1ABCDEF0 | EXTENDED, 0x7FF], np.uint32), np.zeros(3), np.array([3, 2, 0], np.uint8),
        np.array([[1, 0xAB, 0xFF, 0, 0, 0, 0, 0], [0x12, 0x34, 0, 0, 0, 0, 0, 0], [0] * 8], np.uint8),
    )  # fmt: skip
    assert slcan.render(block) == b"t100301ABFF\rT1ABCDEF021234\rt7FF0\r"
    assert slcan.render(FrameBlock.empty()) == b""


# Answers to commands


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"\r", (True, b"")),
        (b"\a", (False, b"")),
        (b"", (None, b"")),
        (b"t10021122\r", (None, b"")),
        (b"t10021122\rt1002", (None, b"t1002")),
        (b"t10021122\r\rt1002", (True, b"t1002")),
        (b"t10021122\r\at1002", (False, b"t1002")),
    ],
)
def test_an_answer_is_told_from_the_frames_around_it(data: bytes, expected: tuple[bool | None, bytes]) -> None:
    assert slcan.answer(data) == expected


# The reader, beside adapters of several kinds


class Adapter(asyncio.Protocol):
    """An adapter that answers as it is told: `answers` by command."""

    def __init__(self, answers: dict[bytes, bytes]) -> None:
        self._answers = answers
        self.heard: list[bytes] = []
        self.lost = False
        self.transport: asyncio.Transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        for command in data.split(b"\r")[:-1]:
            self.heard.append(command)
            answer = self._answers.get(command, b"\r")
            if answer == b"gone":
                self.transport.abort()
            elif answer:
                self.transport.write(answer)

    def connection_lost(self, exc: Exception | None) -> None:
        self.lost = True


ADDRESS = Address.parse("slcan:///dev/ttyACM0?bitrate=250000")


async def opened(adapter: asyncio.Protocol, address: Address = ADDRESS) -> FrameLink:
    async def joined(factory: Callable[[], Slcan]) -> Slcan:
        client = factory()
        join(client, adapter, Line(latency_s=0.001), str(address))
        return client

    return await open_slcan("counter", address, joined)


def with_adapter(use: Callable[[Adapter], Awaitable[None]], answers: dict[bytes, bytes] | None = None) -> None:
    async def main() -> None:
        await use(Adapter(answers or {}))

    run(main(), AS_FAST_AS_POSSIBLE)


def test_opening_closes_the_channel_sets_the_bit_rate_and_opens_it() -> None:
    async def use(adapter: Adapter) -> None:
        link = await opened(adapter)
        assert adapter.heard == [b"C", b"S5", b"O"]
        link.close()
        link.close()
        await asyncio.sleep(0.01)
        assert adapter.heard == [b"C", b"S5", b"O", b"C"]
        assert adapter.lost

    with_adapter(use)


def test_a_channel_that_was_closed_refuses_to_be_closed_and_that_is_well() -> None:
    async def use(adapter: Adapter) -> None:
        await opened(adapter)
        assert adapter.heard == [b"C", b"S5", b"O"]

    with_adapter(use, {b"C": b"\a"})


@pytest.mark.parametrize(("refused", "sent"), [(b"S5", r"sent 'S5'"), (b"O", r"sent 'O'")])
def test_an_adapter_that_refuses_is_named_with_what_was_sent(refused: bytes, sent: str) -> None:
    async def use(adapter: Adapter) -> None:
        with pytest.raises(CannotConnect, match=f"counter: the CAN adapter refused; {sent}"):
            await opened(adapter)
        await asyncio.sleep(0.01)
        assert adapter.lost, "the line is let go"

    with_adapter(use, {refused: b"\a"})


def test_an_adapter_that_a_crash_left_sending_is_not_misunderstood() -> None:
    """Its frames come before its answers; the bit rate that it refuses is seen."""
    frames = b"t10021122\rt10021122\r"

    async def use(adapter: Adapter) -> None:
        with pytest.raises(CannotConnect, match="the CAN adapter refused; sent 'S5'"):
            await opened(adapter)

    with_adapter(use, {b"C": frames + b"\r", b"S5": frames[:5] + b"\a"})


def test_the_first_frames_may_come_with_the_answer_to_opening() -> None:
    async def use(adapter: Adapter) -> None:
        link = await opened(adapter)
        adapter.transport.write(b"22\rt1002334")
        adapter.transport.write(b"4\r")
        await asyncio.sleep(0.01)
        assert rows(link.take()) == [(0x100, 2, "1122"), (0x100, 2, "3344")]

    with_adapter(use, {b"O": b"\rt100211"})


def test_a_silent_adapter_is_not_waited_for_long() -> None:
    async def use(adapter: Adapter) -> None:
        with pytest.raises(CannotConnect, match="counter: the CAN adapter does not answer; sent 'C'"):
            await opened(adapter)
        assert asyncio.get_running_loop().time() == pytest.approx(1.0)

    with_adapter(use, {b"C": b""})


def test_an_adapter_that_only_sends_frames_does_not_answer() -> None:
    async def use(adapter: Adapter) -> None:
        with pytest.raises(CannotConnect, match="does not answer"):
            await opened(adapter)

    with_adapter(use, {b"C": b"t10021122\r"})


def test_an_adapter_that_goes_while_it_is_opened_is_lost() -> None:
    async def use(adapter: Adapter) -> None:
        with pytest.raises(LinkLost, match="counter: the CAN adapter has closed the connection"):
            await opened(adapter)

    with_adapter(use, {b"S5": b"gone"})


def test_an_unknown_bit_rate_is_answered_with_those_it_knows() -> None:
    async def use(adapter: Adapter) -> None:
        with pytest.raises(CannotConnect, match=r"slcan knows the bit rates 10000, 20000, .*, 1000000"):
            await opened(adapter, Address.parse("slcan:///dev/ttyACM0?bitrate=300000"))
        assert adapter.heard == []

    with_adapter(use)


def test_what_arrived_before_the_adapter_went_is_handed_out_first() -> None:
    async def use(adapter: Adapter) -> None:
        link = await opened(adapter)
        adapter.transport.write(LINES)
        adapter.transport.abort()
        await asyncio.sleep(0.01)
        assert rows(link.take()) == FRAMES
        with pytest.raises(LinkLost, match=r"the CAN adapter has closed the connection.* Check the adapter's cable"):
            link.take()
        link.close()

    with_adapter(use)


def test_frames_are_stamped_when_they_arrive_and_lines_go_on_over_portions() -> None:
    async def use(adapter: Adapter) -> None:
        link = await opened(adapter)
        began_s = asyncio.get_running_loop().time()
        for portion in (LINES[:30], LINES[30:33], LINES[33:]):
            adapter.transport.write(portion)
            await asyncio.sleep(1.0)
        block = link.take()
        assert rows(block) == FRAMES
        assert block.at_s - began_s == pytest.approx([0.001, 2.001, 2.001, 2.001])
        assert len(link.take()) == 0

    with_adapter(use)


def test_a_reason_is_told_when_the_system_gives_one() -> None:
    async def use(adapter: Adapter) -> None:
        link = Slcan("counter")
        with pytest.raises(LinkLost, match="counter: not connected"):
            await link.command(b"C")
        link.close()
        with pytest.raises(LinkLost, match="not connected"):
            link.take()
        link.connection_lost(OSError(5, "Input/output error"))
        with pytest.raises(
            LinkLost, match=r"the CAN adapter has closed the connection \(\[Errno 5\] Input/output error\)"
        ):
            link.take()
        with pytest.raises(TypeError, match="a stream transport is needed"):
            link.connection_made(asyncio.BaseTransport())

    with_adapter(use)


# The simulated adapter


def simulated_counter() -> SimulatedCounter:
    loop = asyncio.get_running_loop()
    world = World(WorldSettings(seed=1, gravity_mps2=9.8), loop.time)
    return a_counter(world, FaultPlan(now_s=loop.time))


def test_our_reader_takes_what_the_simulated_adapter_sends() -> None:
    async def main() -> None:
        counter = simulated_counter()
        await asyncio.sleep(5)
        link = await opened(SimulatedAdapter(counter))
        await asyncio.sleep(1.05)
        block = link.take()
        assert block.ids.tolist()[:8] == [0x100, 0x101, 0x102, 0x103] * 2
        assert (block.ids == 0x100).sum() == 10, "what was on the bus before the channel opened is gone"
        assert np.diff(block.at_s[block.ids == 0x100]) == pytest.approx([0.1] * 9, abs=0.03)
        link.close()
        await asyncio.sleep(1)

    run(main(), AS_FAST_AS_POSSIBLE)


class Terminal(asyncio.Protocol):
    """Somebody at a keyboard."""

    def __init__(self) -> None:
        self.said = b""
        self.lost = False

    def data_received(self, data: bytes) -> None:
        self.said += data

    def connection_lost(self, exc: Exception | None) -> None:
        self.lost = True


def test_the_simulated_adapter_refuses_what_a_real_one_refuses() -> None:
    async def main() -> None:
        terminal, adapter = Terminal(), SimulatedAdapter(simulated_counter())
        transport = join(terminal, adapter, Line(), "")
        for command, answer in (
            (b"C\r", b"\a"), (b"O\r", b"\a"), (b"S9\r", b"\a"), (b"S", b""), (b"6\r", b"\r"), (b"\r", b""),
            (b"O\rO\r", b"\r\a"), (b"S6\r", b"\a"), (b"t10021122\r", b"\a"), (b"C\rC\r", b"\r\a"), (b"O\r", b"\r"),
        ):  # fmt: skip
            terminal.said = b""
            transport.write(command)
            await asyncio.sleep(0)
            assert terminal.said == answer, command
        await asyncio.sleep(0.2)
        transport.close()
        await asyncio.sleep(0.1)

    run(main(), AS_FAST_AS_POSSIBLE)


def test_a_cut_closes_the_line() -> None:
    async def main() -> None:
        counter, terminal = simulated_counter(), Terminal()
        transport = join(terminal, SimulatedAdapter(counter), Line(), "")
        transport.write(b"S6\rO\r")
        await asyncio.sleep(1)
        assert not terminal.lost
        counter.faults.begin("cut")
        await asyncio.sleep(1)
        assert terminal.lost

    run(main(), AS_FAST_AS_POSSIBLE)


class FullLine(asyncio.Transport):
    """A line whose other end does not read any more."""

    def __init__(self) -> None:
        super().__init__()
        self.unread = b""

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self.unread += bytes(data)

    def get_write_buffer_size(self) -> int:
        return len(self.unread)


def test_frames_that_nobody_reads_are_dropped_and_do_not_fill_the_memory() -> None:
    async def main() -> None:
        adapter, line = SimulatedAdapter(simulated_counter()), FullLine()
        adapter.connection_made(line)
        adapter.data_received(b"S6\rO\r")
        await asyncio.sleep(120)
        assert UNREAD_LIMIT_BYTES <= len(line.unread) < UNREAD_LIMIT_BYTES + 1000
        adapter.connection_lost(None)
        adapter.data_received(b"C\r")  # too late
        assert line.unread.endswith(b"\r")

    run(main(), AS_FAST_AS_POSSIBLE)
