"""Opening a line, opening it again, and the bound on what makes an instrument safe."""

import asyncio
from collections.abc import Callable

import pytest

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.errors import BadAnswer, LinkLost, NoAnswer
from drivers.transport.address import Address
from drivers.transport.dialogue import Dialogue, safe_in_time
from drivers.transport.exchange import LineExchange, Proof
from drivers.transport.frames import FrameLink
from drivers.transport.memory import Line, MemoryTransport, join


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
    return Dialogue("echo", wires, Address.parse(address), Proof(b"who?", check))


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
        assert await dialogue.line.ask(b"what?", bytes) == b"what?"

    run(main(), AS_FAST_AS_POSSIBLE)


def test_a_serial_line_is_drained_before_its_first_question() -> None:
    async def main() -> None:
        wires = Echoes()
        asyncio.get_running_loop().call_later(0.5, lambda: wires.opened[0].transport.write(b"left over\n"))
        dialogue = a_dialogue(wires, "serial:///dev/ttyUSB0?baud=9600")
        await dialogue.open()
        assert now_s() > 1.5
        assert await dialogue.line.ask(b"what?", bytes) == b"what?"

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
