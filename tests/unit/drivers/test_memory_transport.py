import asyncio
import math
from collections.abc import Awaitable, Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.transport.memory import Line, MemoryTransport, join, let_arrive
from tests.support.memory_stream import open_memory_stream


class End(asyncio.Protocol):
    """One end: what came, when, and how it ended."""

    def __init__(self, *, keeps_open: bool = False) -> None:
        self.arrived: list[tuple[float, bytes]] = []
        self.ended: list[float] = []
        self.lost: list[Exception | None] = []
        self._keeps_open = keeps_open
        self.transport: MemoryTransport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, MemoryTransport)
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        self.arrived.append((now_s(), data))

    def eof_received(self) -> bool:
        self.ended.append(now_s())
        return self._keeps_open

    def connection_lost(self, exc: Exception | None) -> None:
        self.lost.append(exc)


def now_s() -> float:
    return asyncio.get_running_loop().time()


def joined(use: Callable[[End, End], Awaitable[None]], line: Line, *, keeps_open: bool = False) -> tuple[End, End]:
    async def main() -> tuple[End, End]:
        client, server = End(), End(keeps_open=keeps_open)
        assert join(client, server, line, "there") is client.transport
        await use(client, server)
        return client, server

    return run(main(), AS_FAST_AS_POSSIBLE)


def test_a_question_and_its_answer_take_the_latency_once() -> None:
    async def use(client: End, server: End) -> None:
        client.transport.write(b"question")
        assert server.arrived == [(0.0, b"question")]
        server.transport.write(b"answer")
        await asyncio.sleep(1)
        assert client.arrived == [(0.005, b"answer")]

    joined(use, Line(latency_s=0.005))


def test_a_serial_line_takes_its_time_for_every_byte_in_both_directions() -> None:
    async def use(client: End, server: End) -> None:
        client.transport.write(b"12345")
        client.transport.write(b"678")
        await asyncio.sleep(1)
        assert server.arrived == [(pytest.approx(0.05), b"12345"), (pytest.approx(0.08), b"678")]
        server.transport.write(b"12345")
        server.transport.write(b"6")
        await asyncio.sleep(1)
        assert client.arrived == [(pytest.approx(1.06), b"12345"), (pytest.approx(1.07), b"6")]

    joined(use, Line.serial(1000, latency_s=0.01))


def test_who_waits_for_nothing_else_is_brought_the_question_and_then_the_answer_when_they_are_due() -> None:
    async def use(client: End, server: End) -> None:
        client.transport.write(b"12345")
        assert let_arrive(client.transport, math.inf)
        assert server.arrived == [(pytest.approx(0.05), b"12345")]
        assert not let_arrive(client.transport, math.inf)
        server.transport.write(b"6")
        assert let_arrive(client.transport, math.inf)
        assert client.arrived == [(pytest.approx(0.07), b"6")]
        await asyncio.sleep(1)
        assert (len(server.arrived), len(client.arrived)) == (1, 1)

    joined(use, Line.serial(1000, latency_s=0.01))


def test_who_waits_no_longer_is_brought_nothing_at_once() -> None:
    async def use(client: End, server: End) -> None:
        server.transport.write(b"answer")
        assert not let_arrive(client.transport, before_s=0.005)
        assert (now_s(), client.arrived) == (0.0, [])
        assert let_arrive(client.transport, before_s=0.006)

    joined(use, Line(latency_s=0.005))


def test_nothing_arrives_before_what_else_is_to_happen() -> None:
    async def use(client: End, server: End) -> None:
        other = asyncio.create_task(asyncio.sleep(0.001))
        await asyncio.sleep(0)
        server.transport.write(b"answer")
        assert not let_arrive(client.transport, math.inf)
        await other
        assert let_arrive(client.transport, math.inf)
        assert client.arrived == [(0.005, b"answer")]

    joined(use, Line(latency_s=0.005))


@settings(max_examples=50)
@given(
    st.lists(st.tuples(st.floats(0, 0.2), st.binary(max_size=30)), max_size=20),
    st.floats(0, 0.1),
    st.sampled_from([0, 300, 9600]),
)
def test_bytes_arrive_in_order_no_faster_than_the_line_and_none_is_lost(
    writes: list[tuple[float, bytes]], latency_s: float, baud: int
) -> None:
    async def use(client: End, server: End) -> None:
        sent = []
        for pause_s, data in writes:
            await asyncio.sleep(pause_s)
            server.transport.write(data)
            sent.append((now_s(), data))
        await asyncio.sleep(100)
        assert b"".join(data for _, data in client.arrived) == b"".join(data for _, data in sent)
        times = [at_s for at_s, _ in client.arrived]
        assert times == sorted(times)
        for (sent_s, data), (arrived_s, _) in zip([s for s in sent if s[1]], client.arrived, strict=True):
            assert arrived_s >= sent_s + latency_s + len(data) * line.byte_s - 1e-9

    line = Line.serial(baud, latency_s) if baud else Line(latency_s)
    joined(use, line)


def test_closing_ends_both_sides_after_what_was_written() -> None:
    async def use(client: End, server: End) -> None:
        server.transport.write(b"last words")
        server.transport.close()
        server.transport.close()
        server.transport.write(b"too late")
        assert server.transport.is_closing()
        assert not client.transport.is_closing()
        await asyncio.sleep(1)
        assert client.arrived == [(pytest.approx(0.11), b"last words")]
        assert client.transport.is_closing()

    client, server = joined(use, Line.serial(1000, latency_s=0.01))
    assert client.lost == server.lost == [None], "each is told once"


def test_what_arrives_at_a_closed_end_is_dropped() -> None:
    async def use(client: End, server: End) -> None:
        server.transport.write(b"on its way")
        client.transport.abort()
        server.transport.write(b"after")
        await asyncio.sleep(1)
        assert client.arrived == []
        assert server.transport.is_closing()

    joined(use, Line(latency_s=0.01))


def test_the_end_of_file_closes_unless_the_other_side_keeps_open() -> None:
    async def use(client: End, server: End) -> None:
        assert client.transport.can_write_eof()
        client.transport.write(b"all")
        client.transport.write_eof()
        await asyncio.sleep(1)
        assert [data for _, data in server.arrived] == [b"all"]
        assert len(server.ended) == 1

    client, server = joined(use, Line(latency_s=0.01))
    assert (len(client.lost), len(server.lost)) == (1, 1)
    client, server = joined(use, Line(latency_s=0.01), keeps_open=True)
    assert (len(client.lost), len(server.lost)) == (0, 0)


def test_a_paused_end_gets_everything_in_order_later() -> None:
    async def use(client: End, server: End) -> None:
        assert client.transport.is_reading()
        client.transport.pause_reading()
        assert not client.transport.is_reading()
        for data in (b"1", b"2", b"3"):
            server.transport.write(data)
        await asyncio.sleep(1)
        assert client.arrived == []
        client.transport.resume_reading()
        server.transport.write(b"4")
        await asyncio.sleep(1)
        assert [data for _, data in client.arrived] == [b"1", b"2", b"3", b"4"]

    joined(use, Line())


def test_a_protocol_may_pause_while_it_is_given_what_was_kept() -> None:
    class Hesitant(End):
        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            self.transport.pause_reading()

    async def main() -> None:
        client, server = Hesitant(), End()
        join(client, server, Line(), "there")
        for data in (b"1", b"2", b"3"):
            server.transport.write(data)
        for so_far in (1, 2, 3):
            assert len(client.arrived) == so_far
            client.transport.resume_reading()
            await asyncio.sleep(0.01)
        assert [data for _, data in client.arrived] == [b"1", b"2", b"3"]

    run(main(), AS_FAST_AS_POSSIBLE)


def test_what_was_kept_at_a_pause_is_dropped_by_closing() -> None:
    async def use(client: End, server: End) -> None:
        client.transport.pause_reading()
        server.transport.write(b"1")
        client.transport.close()
        client.transport.resume_reading()
        await asyncio.sleep(1)
        assert client.arrived == []
        assert not client.transport.is_reading()

    joined(use, Line())


def test_a_connection_can_be_handed_to_another_protocol() -> None:
    async def use(client: End, server: End) -> None:
        other = End()
        client.transport.set_protocol(other)
        assert client.transport.get_protocol() is other
        server.transport.write(b"for the other")
        assert [data for _, data in other.arrived] == [b"for the other"]
        assert client.arrived == []
        with pytest.raises(TypeError, match=r"a stream needs an asyncio\.Protocol"):
            client.transport.set_protocol(asyncio.BaseProtocol())

    joined(use, Line())


def test_each_end_knows_the_name_of_the_other() -> None:
    async def use(client: End, server: End) -> None:
        assert client.transport.get_extra_info("peername") == "there"
        assert server.transport.get_extra_info("sockname") == "there"
        assert client.transport.get_write_buffer_size() == 0
        client.transport.set_write_buffer_limits(1, 0)

    joined(use, Line())


def test_streams_work_as_on_a_socket() -> None:
    class Echo(End):
        def data_received(self, data: bytes) -> None:
            self.transport.write(data.upper())

    async def main() -> None:
        reader, writer = open_memory_stream(Echo, Line(latency_s=0.01), "there")
        writer.write(b"hello\n")
        await writer.drain()
        assert await reader.readline() == b"HELLO\n"
        assert now_s() == pytest.approx(0.01)
        writer.close()
        await writer.wait_closed()
        assert await reader.read() == b""

    run(main(), AS_FAST_AS_POSSIBLE)
