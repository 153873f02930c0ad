"""Opening a line, opening it again, and the bound on what makes an instrument safe."""

import asyncio
from collections.abc import Callable
from itertools import pairwise

import pytest

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.description import IdentityPin, Nothing, Setup, ignore_note
from drivers.errors import BadAnswer, CannotConnect, LinkLost, NoAnswer
from drivers.transport.address import Address
from drivers.transport.dialogue import Dialogue, safe_in_time
from drivers.transport.exchange import LineExchange, SyncQuery
from drivers.transport.frame_link import FrameLink
from drivers.transport.memory import Line, MemoryTransport, join
from drivers.transport.wires import Wires


class Echo(asyncio.Protocol):
    """Says `head` and what it heard."""

    def __init__(self, head: bytes) -> None:
        self.head = head
        self.heard: list[bytes] = []
        self.transport: MemoryTransport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, MemoryTransport)
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        self.heard.append(data)
        self.transport.write(self.head + data)


class Echoes:
    """A Wires with an echo at every place."""

    def __init__(self, head: bytes = b"") -> None:
        self.head = head
        self.opened: list[Echo] = []

    async def stream(self, device: str, address: Address, factory: Callable[[], LineExchange]) -> LineExchange:
        line, echo = factory(), Echo(self.head)
        self.opened.append(echo)
        join(line, echo, Line(latency_s=0.001), str(address))
        return line

    async def frames(self, device: str, address: Address) -> FrameLink:
        raise NotImplementedError


def check(line: bytes) -> None:
    if line != b"who?":
        raise ValueError("is another")


def a_dialogue(wires: Echoes, address: str = "tcp://127.0.0.1:5025") -> Dialogue:
    return dialogue_of(wires, Address.parse(address), ignore_note)


def dialogue_of(wires: Wires, address: Address, note: Callable[[str], object]) -> Dialogue:
    setup = Setup("echo", address, wires, Nothing(), Nothing(), Nothing(), IdentityPin(), note=note)
    return Dialogue(setup, SyncQuery(b"who?", check))


def now_s() -> float:
    return asyncio.get_running_loop().time()


def test_a_dialogue_that_was_never_opened_is_not_connected() -> None:
    dialogue = a_dialogue(Echoes())
    dialogue.close()
    with pytest.raises(LinkLost, match="echo: is not connected"):
        _ = dialogue.line


def test_opening_asks_for_the_proof() -> None:
    async def main() -> None:
        wires = Echoes()
        dialogue = a_dialogue(wires)
        await dialogue.open()
        assert wires.opened[0].heard == [b"who?\n"]
        assert now_s() < 0.1
        assert await dialogue.line.query(b"what?", bytes) == b"what?"

    run(main(), AS_FAST_AS_POSSIBLE)


def test_a_serial_line_is_drained_before_its_first_question() -> None:
    async def main() -> None:
        wires = Echoes()
        asyncio.get_running_loop().call_later(0.5, lambda: wires.opened[0].transport.write(b"left over\n"))
        dialogue = a_dialogue(wires, "serial:///dev/ttyUSB0?baud=9600")
        await dialogue.open()
        assert now_s() > 1.5
        assert await dialogue.line.query(b"what?", bytes) == b"what?"

    run(main(), AS_FAST_AS_POSSIBLE)


def test_a_line_to_the_wrong_instrument_is_closed() -> None:
    async def main() -> None:
        wires = Echoes(head=b"not ")
        with pytest.raises(BadAnswer, match="is another"):
            await a_dialogue(wires).open()
        await asyncio.sleep(0.1)
        assert wires.opened[0].transport.is_closing()

    run(main(), AS_FAST_AS_POSSIBLE)


def test_only_a_lost_line_is_opened_again() -> None:
    async def main() -> None:
        wires = Echoes()
        dialogue = a_dialogue(wires)
        assert await dialogue.reopen()
        assert not await dialogue.reopen()
        wires.opened[0].transport.close()
        await asyncio.sleep(0.1)
        assert await dialogue.reopen()
        assert len(wires.opened) == 2
        await dialogue.open()
        await asyncio.sleep(0.1)
        assert [echo.transport.is_closing() for echo in wires.opened] == [True, True, False]

    run(main(), AS_FAST_AS_POSSIBLE)


def test_making_safe_is_bounded_and_other_timeouts_stay_what_they_are() -> None:
    async def main() -> None:
        with pytest.raises(NoAnswer, match="head: is not proved safe within 5 s"):
            async with safe_in_time("head"):
                await asyncio.sleep(60)
        assert now_s() == pytest.approx(5.0)
        with pytest.raises(NoAnswer, match="of its own"):
            async with safe_in_time("head"):
                raise NoAnswer("head", "of its own")

    run(main(), AS_FAST_AS_POSSIBLE)


# A wire that is lost


class Moody(Echoes):
    """Refuses connections on demand."""

    refuses = False

    async def stream(self, device: str, address: Address, factory: Callable[[], LineExchange]) -> LineExchange:
        if self.refuses:
            raise CannotConnect(device, "refused")
        return await super().stream(device, address, factory)


def test_a_question_connects_again_after_a_lost_wire_and_says_so() -> None:
    wires, notes = Moody(), list[str]()

    async def main() -> None:
        address = Address.parse("tcp://127.0.0.1:5025")
        dialogue = dialogue_of(wires, address, notes.append)
        await dialogue.open()
        wires.opened[-1].transport.abort()
        await asyncio.sleep(1.0)
        assert await dialogue.query(b"what?", bytes) == b"what?"
        assert wires.opened[-1].heard == [b"who?\n", b"what?\n"]
        dialogue.close()

    run(main(), AS_FAST_AS_POSSIBLE)
    assert notes == [
        "connected and identified again at tcp://127.0.0.1:5025: the connection was closed (by the other end)"
    ]


def test_a_command_does_not_connect_again() -> None:
    wires = Moody()

    async def main() -> None:
        dialogue = a_dialogue(wires)
        await dialogue.open()
        wires.opened[-1].transport.abort()
        await asyncio.sleep(1.0)
        with pytest.raises(LinkLost):
            await dialogue.send_command(b"move!", bytes)
        assert len(wires.opened) == 1

    run(main(), AS_FAST_AS_POSSIBLE)


def test_attempts_to_connect_again_come_after_longer_and_longer_pauses() -> None:
    wires, attempts_s, reported = Moody(), list[float](), set[str]()

    async def main() -> None:
        dialogue = a_dialogue(wires)
        await dialogue.open()
        wires.opened[-1].transport.abort()
        await asyncio.sleep(0.5)
        wires.refuses, began_s = True, now_s()
        for _ in range(2000):
            try:
                await dialogue.query(b"what?", bytes)
            except CannotConnect:
                attempts_s.append(round(now_s() - began_s, 1))
            except LinkLost as problem:
                reported.add(str(problem).partition("is in")[0])
            await asyncio.sleep(0.1)
        wires.refuses = False
        await asyncio.sleep(30.0)
        assert await dialogue.query(b"what?", bytes) == b"what?"
        dialogue.close()

    run(main(), AS_FAST_AS_POSSIBLE)
    pauses_s = [after - before for before, after in pairwise(attempts_s)]
    assert pauses_s == pytest.approx([1, 2, 4, 8, 16, 30, 30, 30, 30, 30][: len(pauses_s)], abs=0.15)
    assert len(pauses_s) > 7
    assert reported == {"echo: is not connected; the next attempt "}


def test_a_connection_that_is_open_at_one_end_only_is_given_up_and_made_anew() -> None:
    wires = Moody()

    async def main() -> None:
        dialogue = a_dialogue(wires)
        await dialogue.open()
        wires.opened[-1].transport.write = lambda _data: None
        with pytest.raises(NoAnswer, match=r"sent 'what\?'"):  # the question, then the proof on the same wire
            await dialogue.query(b"what?", bytes)
        assert await dialogue.query(b"what?", bytes) == b"what?"
        assert len(wires.opened) == 2
        dialogue.close()

    run(main(), AS_FAST_AS_POSSIBLE)


def test_a_port_has_no_other_end_and_is_kept() -> None:
    wires = Moody()

    async def main() -> None:
        dialogue = a_dialogue(wires, "serial:///dev/ttyUSB0")
        await dialogue.open()
        wires.opened[-1].transport.write = lambda _data: None
        for _ in range(4):
            with pytest.raises(NoAnswer):
                await dialogue.query(b"what?", bytes)
        assert len(wires.opened) == 1
        dialogue.close()

    run(main(), AS_FAST_AS_POSSIBLE)
