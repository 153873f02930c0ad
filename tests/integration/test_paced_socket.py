"""Reading of a real socket: by portions or by a timer, and what belongs to an acquisition."""

from __future__ import annotations

import asyncio
import os
import socket
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import numpy as np
import pytest

from bench.loop import REAL_TIME, run
from drivers.errors import LinkLost
from drivers.kinds.frame_source.intake import FrameIntake
from drivers.transport.alike import Portion
from drivers.transport.frame_link import FrameLink
from drivers.transport.paced_socket import READ_EVERY_S, PacedSocket
from tests.support.frames import taken
from tests.support.loopback import SaysHi, linked, served

pytestmark = pytest.mark.integration

MANY = 100  # frames at once: enough to be read by the timer


class Server(SaysHi):
    """A server that opens any bus, and sends the frames of a test."""

    def data_received(self, data: bytes) -> None:
        self.transport.write(b"< ok >")

    def send(self, frame_id: int, count: int = 1) -> None:
        """Send frames at once: they wait in the system when this returns."""
        os.write(
            self.transport.get_extra_info("socket").fileno(),
            b"< frame %03X 1690000000.000100 0A0B >" % frame_id * count,
        )


@asynccontextmanager
async def opened() -> AsyncIterator[tuple[Server, FrameLink]]:
    peer = Server()
    server, port = await served(lambda: peer)
    link = await linked(port)
    try:
        yield peer, link
    finally:
        link.close()
        server.close()


async def read_by_the_timer(server: Server) -> None:
    """Let so much arrive that the link is read by the timer, and not for a while now."""
    server.send(0x100, MANY)
    await asyncio.sleep(READ_EVERY_S / 8)


def test_while_much_arrives_the_loop_is_not_woken_for_each_text(monkeypatch: pytest.MonkeyPatch) -> None:
    delivered: list[Portion] = []
    note = PacedSocket.note

    def noted(self: PacedSocket, portion: Portion) -> None:
        delivered.append(portion)
        note(self, portion)

    monkeypatch.setattr(PacedSocket, "note", noted)

    async def main() -> None:
        async with opened() as (server, link):
            sent_s: list[float] = []
            for _ in range(300):
                sent_s.append(asyncio.get_running_loop().time())
                server.send(0x100, 4)
                await asyncio.sleep(0.001)
            at_s = (await taken(link, 1200, 5.0)).at_s
            assert len(delivered) < 100, "of 300 portions"
            between_s = np.diff(at_s)
            assert (between_s >= 0).all()
            pause_s = np.diff(sent_s).max()  # of the sender, long on a busy machine
            assert between_s.max() < READ_EVERY_S + pause_s
            assert np.median(between_s[between_s > 0]) < READ_EVERY_S / 2, "they are not all as late as the last one"
            await asyncio.sleep(5 * READ_EVERY_S)
            seen = len(delivered)
            server.send(0x101)
            await asyncio.sleep(READ_EVERY_S / 4)
            assert len(delivered) == seen + 1, "little is delivered as it comes"
            server.send(0x101, 2)
            at_s = link.take().at_s
            assert len(at_s) == 3
            assert at_s[1] == at_s[2], "nothing was read late"

    run(main(), REAL_TIME)


@pytest.mark.parametrize("much", [False, True])
def test_what_waits_in_the_system_at_the_limits_of_an_acquisition_is_on_its_side(much: bool) -> None:
    async def main() -> None:
        async with opened() as (server, link):
            intake = FrameIntake("counter", link, lambda block: None, lambda text: None)
            intake.begin()
            if much:
                await read_by_the_timer(server)
            server.send(0x111)
            async with intake.acquire(None) as blocks:
                await asyncio.sleep(3 * READ_EVERY_S)
                server.send(0x222, 2)
            server.send(0x333)
            found = [block async for block in blocks]
            assert [frame for block in found for frame in block.ids.tolist()] == [0x222, 0x222]
            await intake.end()

    run(main(), REAL_TIME)


def test_no_frame_is_older_than_the_last_time_that_there_was_none() -> None:
    async def main() -> None:
        async with opened() as (server, link):
            await read_by_the_timer(server)
            assert len(link.take()) == MANY
            await asyncio.sleep(READ_EVERY_S / 4)
            assert not len(link.take())
            at_s = asyncio.get_running_loop().time()
            await asyncio.sleep(READ_EVERY_S / 16)
            server.send(0x101, 2)
            assert (link.take().at_s > at_s).all()

    run(main(), REAL_TIME)


@pytest.mark.parametrize("reset", [False, True])
def test_a_server_that_closes_while_it_is_read_by_the_timer_is_reported_after_its_last_frames(reset: bool) -> None:
    async def main() -> None:
        async with opened() as (server, link):
            await read_by_the_timer(server)
            server.send(0x222, 3)
            if reset:
                ended = server.transport.get_extra_info("socket")
                ended.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            server.transport.close()
            block = await taken(link, MANY + 3, 5.0)
            assert block.ids.tolist() == [0x100] * MANY + [0x222] * 3
            with pytest.raises(LinkLost, match="the socketcand server has closed the connection"):
                await taken(link, 1, 5.0)

    run(main(), REAL_TIME)


def test_an_acquisition_reports_a_server_that_has_just_closed() -> None:
    async def main() -> None:
        async with opened() as (server, link):
            intake = FrameIntake("counter", link, lambda block: None, lambda text: None)
            intake.begin()
            async with intake.acquire(None) as blocks:
                await read_by_the_timer(server)
                server.transport.close()
                await asyncio.sleep(0)
                await asyncio.sleep(0)
            with pytest.raises(LinkLost, match="the socketcand server has closed the connection"):
                [block async for block in blocks]
            await intake.end()

    run(main(), REAL_TIME)


def test_a_closed_link_reads_no_other_file_that_has_its_number() -> None:
    async def main() -> None:
        async with opened() as (server, link):
            before = set(os.listdir("/proc/self/fd"))
            await read_by_the_timer(server)
            link.close()
            await asyncio.sleep(0)
            await asyncio.sleep(0)
            ours, others = socket.socketpair()
            with ours, others:
                assert {str(ours.fileno()), str(others.fileno())} & before, "a number was free"
                ours.setblocking(False)
                others.setblocking(False)
                ours.send(b"one")
                others.send(b"two")
                await asyncio.sleep(3 * READ_EVERY_S)
                assert (others.recv(9), ours.recv(9)) == (b"one", b"two")

    run(main(), REAL_TIME)
