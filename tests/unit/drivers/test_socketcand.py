"""CAN over TCP: texts into frames and back, and the way to an open bus."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import numpy as np
import pytest

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.can.frame_block import ERROR, EXTENDED, FrameBlock
from drivers.errors import CannotConnect, LinkLost
from drivers.transport.address import Address
from drivers.transport.alike import Arrivals, Portion
from drivers.transport.memory import Line, join
from drivers.transport.socketcand import Socketcand, open_socketcand, parse, render
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.can_nodes.can_counter import SimulatedCounter
from simulators.instruments.can_nodes.socketcand_server import SimulatedServer
from simulators.units.settings import WorldSettings
from simulators.world import World
from tests.support.laboratory import a_counter

ADDRESS = Address.parse("socketcand://192.168.1.30:29536/can0")
TEXTS = (
    b"< frame 123 1690000000.000100 0A0B >"
    b"< frame 1ABCDEF0 1690000000.000200 FFEE >"
    b"< frame 7FF 1690000000.000300  >"  # without data, as servers write it
    b"< frame 123 23.424242 11 22 33 44 >"  # as the protocol's description has it
    b"< error 040 1690000000.000400 >"
    b"< error 20000008 1690000000.000500 >"  # an older server
)
FRAMES = [
    (0x123, 2, "0a0b"),
    (0x1ABCDEF0 | EXTENDED, 2, "ffee"),
    (0x7FF, 0, ""),
    (0x123, 4, "11223344"),
    (ERROR | 0x040, 0, ""),
    (ERROR | 0x008, 0, ""),
]


def rows(block: FrameBlock) -> list[tuple[int, int, str]]:
    return [
        (int(frame_id), int(dlc), data[:dlc].tobytes().hex())
        for frame_id, dlc, data in zip(block.ids, block.dlc, block.data, strict=True)
    ]


# Texts


def test_texts_are_frames() -> None:
    block, rest, junk = parse(TEXTS, Arrivals.at_once(12.5))
    assert rows(block) == FRAMES
    assert (rest, junk) == (b"", 0)
    assert block.at_s.tolist() == [12.5] * 6


@pytest.mark.parametrize("cut", range(len(TEXTS) + 1))
def test_texts_may_be_cut_at_every_byte(cut: int) -> None:
    first, rest, junk = parse(TEXTS[:cut], Arrivals.at_once(0.0))
    second, end, more_junk = parse(rest + TEXTS[cut:], Arrivals.at_once(1.0))
    assert rows(first) + rows(second) == FRAMES
    assert (end, junk, more_junk) == (b"", 0, 0)


@pytest.mark.parametrize(
    "text",
    [
        b"< frame 12 1.0 00 >", b"< frame 1234 1.0 00 >", b"< frame 123 1.0 0 >", b"< frame 123 00 >", b"<frame>",
        b"< frame 123 1.0 000102030405060708 >", b"< frame XYZ 1.0 00 >", b"< error could not open bus >",
    ],
)  # fmt: skip
def test_a_text_that_is_no_frame_is_counted_and_harms_no_other(text: bytes) -> None:
    block, rest, junk = parse(TEXTS + text + TEXTS, Arrivals.at_once(0.0))
    assert rows(block) == FRAMES * 2
    assert (rest, junk) == (b"", 1)


def test_texts_of_other_kinds_are_neither_frames_nor_errors() -> None:
    block, rest, junk = parse(b"< ok >< rtr 123 23.424242 4 >< echo >< stat 1 2 3 4 >" + TEXTS, Arrivals.at_once(0.0))
    assert rows(block) == FRAMES
    assert (rest, junk) == (b"", 0)


def test_texts_of_equal_length_may_differ_in_everything() -> None:
    texts = [
        b"< frame 123 1690000000.000100 0A0B >", b"< frame 124 1690000000.000100 0C0D >",
        b"< frame 123 169000000x.000100 0A0B >", b"< frame 123 1690000000 000100 0A0B >",
        b"< frame 12X 1690000000.000100 0A0B >", b"< frame 123 169000000.000100  0E0F >",
        b"< frame 123 16900000000.00100 1112 >", b"< error 040 1690000000.0001 0000 0 >",
    ]  # fmt: skip
    assert len(set(map(len, texts))) == 1
    block, rest, junk = parse(b"".join(texts), Arrivals.at_once(0.0))
    found = [(0x123, "0a0b"), (0x124, "0c0d"), (0x123, "0e0f"), (0x123, "1112"), (ERROR | 0x040, "")]
    assert [(frame_id, data) for frame_id, _, data in rows(block)] == found
    assert (rest, junk) == (b"", 3)


def test_a_frame_has_the_time_at_which_its_end_arrived() -> None:
    chunks = [Portion(1.0, 1.0, TEXTS[:50]), Portion(2.0, 2.0, TEXTS[50:120]), Portion(3.0, 3.0, TEXTS[120:])]
    ends = [at for at in range(len(TEXTS)) if TEXTS[at : at + 1] == b">"]
    block, _, _ = parse(TEXTS, Arrivals.of(chunks))
    assert block.at_s.tolist() == [1.0 if end < 50 else 2.0 if end < 120 else 3.0 for end in ends]


def test_texts_that_were_read_late_arrived_evenly_since_the_reading_before() -> None:
    text = b"< frame 123 1690000000.000100 0A0B >"
    block, _, _ = parse(
        text * 8, Arrivals.of([Portion(1.0, 1.0, text), Portion(2.0, 3.0, text * 4), Portion(3.0, 3.5, text * 3)])
    )
    assert block.at_s == pytest.approx([1.0, 2.25, 2.5, 2.75, 3.0, 3.0 + 1 / 6, 3.0 + 2 / 6, 3.5])
    assert block.at_s[[0, 4, 7]].tolist() == [1.0, 3.0, 3.5], "the last one at the reading itself, to the bit"


def test_a_text_without_an_end_is_not_kept_for_ever() -> None:
    assert parse(b"< frame " + b"0" * 10_000, Arrivals.at_once(0.0))[1:] == (b"", 0)


def test_frames_are_rendered_as_a_server_sends_them() -> None:
    block = FrameBlock(
        np.array([0x123, 0x1ABCDEF0 | EXTENDED, 0x7FF, ERROR | 0x040], np.uint32), np.array([0.0001, 0.0002, 1.5, 2.0]),
        np.array([2, 1, 0, 0], np.uint8), np.array([[10, 11, *[0] * 6], [0xFF, *[0] * 7], [0] * 8, [0] * 8], np.uint8),
    )  # fmt: skip
    assert render(block, 100.0) == (
        b"< frame 123 100.000100 0A0B >< frame 1ABCDEF0 100.000200 FF >< frame 7FF 101.500000  >"
        b"< error 040 102.000000 >"
    )


# The way to an open bus


class Server(asyncio.Protocol):
    """Says `greeting`, then to each request the next of `answers`."""

    def __init__(self, *answers: bytes, greeting: bytes = b"< hi >") -> None:
        self.greeting, self.answers, self.heard = greeting, list(answers), b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        transport.write(self.greeting)

    def data_received(self, data: bytes) -> None:
        self.heard += data
        if self.answers:
            self.transport.write(self.answers.pop(0))


async def opened(server: asyncio.Protocol) -> Socketcand:
    async def joined(factory: Callable[[], Socketcand]) -> Socketcand:
        client = factory()
        join(client, server, Line(latency_s=0.01), "server")
        return client

    return await open_socketcand("counter", ADDRESS, joined)


def with_loop(use: Callable[[], Awaitable[None]]) -> None:
    async def main() -> None:
        await use()

    run(main(), AS_FAST_AS_POSSIBLE)


def test_a_bus_is_opened_and_its_frames_come() -> None:
    async def use() -> None:
        server = Server(b"< ok >", b"< ok >" + TEXTS[:20])
        link = await opened(server)
        assert server.heard == b"< open can0 >< rawmode >"
        server.transport.write(TEXTS[20:])
        await asyncio.sleep(1)
        assert rows(link.take()) == FRAMES, "what came with the answer is not lost"
        assert len(link.take()) == 0
        server.transport.write(TEXTS)
        server.transport.abort()
        await asyncio.sleep(1)
        assert rows(link.take()) == FRAMES
        with pytest.raises(LinkLost, match="the socketcand server has closed the connection"):
            link.take()
        link.close()
        link.close()

    with_loop(use)


@pytest.mark.parametrize(
    ("server", "message"),
    [
        (Server(greeting=b""), r"no < hi > within 3 s\. Check"),
        (Server(greeting=b"SSH-2.0-OpenSSH_9.2\r\n"), r"no < hi > within 3 s; received 'SSH-2.0"),
        (
            Server(b"< error could not open bus >"),
            r"was refused; received '< error could not open bus >'. Check the",
        ),
        (Server(b"< ok >"), r"no < ok > within 3 s; sent '< rawmode >'\. Check"),
    ],
)
def test_a_server_that_does_not_open_the_bus_is_told_with_what_it_said(server: Server, message: str) -> None:
    async def use() -> None:
        with pytest.raises(CannotConnect, match=message):
            await opened(server)
        await asyncio.sleep(1)
        assert server.transport.is_closing()

    with_loop(use)


def test_a_server_that_closes_is_told() -> None:
    class Closing(Server):
        def data_received(self, data: bytes) -> None:
            self.transport.close()

    async def use() -> None:
        with pytest.raises(CannotConnect, match="it has closed the connection; sent '< open can0 >'"):
            await opened(Closing())

    with_loop(use)


# The simulated server


def node(faults: FaultPlan) -> SimulatedCounter:
    world = World(WorldSettings(seed=1, gravity_mps2=9.8), asyncio.get_running_loop().time)
    return a_counter(world, faults)


def test_the_simulated_server_sends_what_its_node_sends() -> None:
    async def use() -> None:
        faults = FaultPlan(now_s=asyncio.get_running_loop().time)
        link = await opened(SimulatedServer(node(faults), "can0"))
        await asyncio.sleep(10.0)
        assert (link.take().ids == 0x100).sum() in (99, 100)
        faults.begin("bus_off")
        await asyncio.sleep(1.0)
        assert (link.take().ids == (ERROR | 0x040)).sum() == 1
        faults.begin("cut")
        await asyncio.sleep(1.0)
        with pytest.raises(LinkLost):
            link.take()

    with_loop(use)


def test_the_simulated_server_has_one_bus() -> None:
    async def use() -> None:
        with pytest.raises(CannotConnect, match="could not open bus"):
            await opened(SimulatedServer(node(FaultPlan()), "can1"))

    with_loop(use)
