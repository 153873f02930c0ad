"""Readings on bad lines: none is wrong, each comes or fails in time, and the driver finds its instrument again."""

import asyncio
import sys
from collections.abc import Callable, Sequence

import pytest
from pymodbus.framer.rtu import FramerRTU

from bench.loop import AS_FAST_AS_POSSIBLE, REAL_TIME, BenchLoop, run
from campaigns.line_faults.campaign import play
from campaigns.line_faults.cases import CASES, Link
from campaigns.line_faults.gain import believed, one_take
from campaigns.line_faults.orders import ORDERS, play_orders
from drivers.description import known_drivers
from drivers.dialects.acutronic_acl import wire as acl
from drivers.dialects.framed.wire import FrameFormat
from drivers.errors import NoAnswer
from drivers.transport.exchange import LineExchange
from drivers.transport.memory import Line
from drivers.transport.modbus import ModbusLink
from simulators.faults.line_faults import FaultyLine, LineFault, in_turn, random_faults
from simulators.serving.proxy import serve_bad_line
from tests.support.instruments import tried

READINGS = 1300 // len(CASES) + 1  # on each
ORDERS_EACH = 24


def test_every_driver_of_a_serial_line_is_tried_on_a_bad_one() -> None:
    on_serial_lines = {name for name in tried("bad lines") if known_drivers()[name].schemes & {"serial", "socket"}}
    assert on_serial_lines == {case.driver for case in CASES.values() if case.link is not Link.TCP}


@pytest.mark.parametrize("name", CASES)
def test_no_reading_over_a_bad_line_is_wrong_or_late(name: str) -> None:
    tally = play(name, CASES[name], READINGS, seed=1)
    assert tally.unexpected == []
    assert tally.trials == READINGS
    assert tally.outcomes["reported"] + tally.outcomes["asked again"] > READINGS / 5


@pytest.mark.parametrize("name", ORDERS)
def test_no_order_over_a_bad_line_is_sent_twice_or_done_otherwise(name: str) -> None:
    tally = play_orders(name, ORDERS_EACH, seed=1)
    assert tally.unexpected == []
    assert tally.outcomes["done"] > 0


def test_two_takes_find_most_of_what_a_grammar_cannot() -> None:
    compared, unexpected = believed(40, seed=1)
    assert unexpected == []
    with one_take():
        trusted, _ = believed(40, seed=1)
    assert trusted > 6 * max(compared, 1)


# Bugs that were planted: the campaign has to find each


def test_a_client_that_takes_whatever_comes_first_for_its_answer_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    async def trusting(self: LineExchange) -> None:
        self._doubts = 0

    monkeypatch.setattr(LineExchange, "_make_ready", trusting)
    assert play("supply", CASES["scpi_supply"], 60, 1, [LineFault.LATE]).unexpected


def test_a_client_that_does_not_look_at_checksums_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FramerRTU, "check_CRC", lambda *_: True)
    tally = play("chamber", CASES["watlow_f4t, RTU"], 60, 1, [LineFault.FLIP])
    assert tally.outcomes["wrong"] > 0


def test_a_client_that_does_not_look_at_lengths_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        acl, "whole_answer", lambda received, order: (len(received),) * 2 if len(received) > 8 else None
    )
    monkeypatch.setattr(
        acl, "read_reply", lambda answer, order: acl.Reply(acl.NO_ERROR, bytes(answer[8:]).decode("ascii"))
    )
    assert play("table", CASES["acutronic_acl"], 40, 1, [LineFault.CUT, LineFault.SPLIT]).unexpected


def test_a_client_that_waits_longer_than_it_may_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    in_time = LineExchange._exchange

    async def patient(
        self: LineExchange, question: bytes, read: Callable[[bytes], object], answer_s: float | None = None
    ) -> object:
        return await in_time(self, question, read, 10.0)

    monkeypatch.setattr(LineExchange, "_exchange", patient)
    tally = play("supply", CASES["scpi_supply"], 2, 1, [LineFault.SILENCE])
    assert "at most 6 s are allowed" in tally.unexpected[0]


def test_a_client_that_sends_a_move_again_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    once = LineExchange.send_command

    async def stubborn(
        self: LineExchange, command: bytes, read: Callable[[bytes], object], *, answer_s: float | None = None
    ) -> object:
        answer = await once(self, command, read, answer_s=answer_s)
        return await once(self, command, read, answer_s=answer_s) if answer is None else answer

    monkeypatch.setattr(LineExchange, "send_command", stubborn)
    tally = play_orders("aerotech_ensemble", 24, 1, [LineFault.SILENCE])
    assert any("was sent 2 times" in sentence for sentence in tally.unexpected)


def test_a_client_that_writes_registers_again_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    once = ModbusLink.write

    async def stubborn(self: ModbusLink, address: int, words: Sequence[int], *, many: bool = False) -> None:
        try:
            await once(self, address, words, many=many)
        except NoAnswer:
            await self.open()
            await once(self, address, words, many=many)

    monkeypatch.setattr(ModbusLink, "write", stubborn)
    tally = play_orders("watlow_f4t, RTU", 24, 1, [LineFault.SILENCE])
    assert any("was sent 2 times" in sentence for sentence in tally.unexpected)


def test_a_client_that_takes_a_frame_by_its_header_alone_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    def fits(self: FrameFormat, received: bytes, at: int) -> bool:
        return len(received) >= at + self.length and self.may_begin(received, at)

    monkeypatch.setattr(FrameFormat, "fits", fits)
    tally = play("table", CASES["framed_table, TCP"], 60, 1, [LineFault.FLIP])
    assert tally.outcomes["wrong"] > 0


# The line itself


class Answering(asyncio.Protocol):
    """A server that answers every request with `answer`."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        self.transport.write(b"answer\n")


class Receiving(asyncio.Protocol):
    def __init__(self) -> None:
        self.heard: list[tuple[float, bytes]] = []
        self.lost_at_s: float | None = None

    def data_received(self, data: bytes) -> None:
        self.heard.append((round(asyncio.get_running_loop().time(), 3), data))

    def connection_lost(self, exc: Exception | None) -> None:
        self.lost_at_s = asyncio.get_running_loop().time()


def received_after(fault: LineFault, seed: int = 1) -> Receiving:
    """What a client hears that asks twice, 10 s apart, when the first answer suffers."""
    client = Receiving()

    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, BenchLoop)
        bad = FaultyLine(seed, in_turn([fault]), client_timeout_s=1.0)
        loop.serve_in_memory("instrument", 1, bad.server(Answering), Line())
        transport, _ = await loop.create_connection(lambda: client, "instrument", 1)
        for _ in range(2):
            transport.write(b"question\n")
            await asyncio.sleep(10.0)

    run(main(), AS_FAST_AS_POSSIBLE)
    return client


GOOD = (10.0, b"answer\n")


@pytest.mark.parametrize(
    ("fault", "heard"),
    [
        (LineFault.SILENCE, [GOOD]),
        (LineFault.DELAY, [(0.5, b"answer\n"), GOOD]),
        (LineFault.LATE, [(1.1, b"answer\n"), GOOD]),
        (LineFault.DUPLICATE, [(0.0, b"answer\nanswer\n"), GOOD]),
        (LineFault.ECHO, [(0.0, b"question\nanswer\n"), GOOD]),
        (LineFault.HALF_OPEN, []),
        (LineFault.RESET, []),
        (LineFault.SLOW_CLOSE, []),
    ],
)
def test_the_first_answer_suffers_what_was_chosen_and_the_next_none(
    fault: LineFault, heard: list[tuple[float, bytes]]
) -> None:
    client = received_after(fault)
    assert client.heard == heard
    assert client.lost_at_s == {LineFault.RESET: 0.0, LineFault.SLOW_CLOSE: 0.5}.get(fault)


def test_an_answer_in_pieces_is_whole_in_the_end() -> None:
    client = received_after(LineFault.SPLIT)
    pieces = [data for at_s, data in client.heard if at_s < 10.0]
    assert b"".join(pieces) == b"answer\n"
    assert [len(piece) for piece in pieces] == [1] * 7


def test_altered_answers_differ_by_what_their_fault_says_and_are_the_same_with_the_same_seed() -> None:
    for seed in range(20):
        (_, cut), (_, garbage), (_, flipped) = (
            received_after(fault, seed).heard[0] for fault in (LineFault.CUT, LineFault.GARBAGE, LineFault.FLIP)
        )
        assert b"answer\n".startswith(cut) or cut == b"answer\n"
        assert garbage.endswith(b"answer\n")
        assert len(garbage) > 7
        assert sum((a ^ b).bit_count() for a, b in zip(flipped, b"answer\n", strict=True)) == 1
        assert received_after(LineFault.FLIP, seed).heard[0] == (0.0, flipped)


def test_faults_that_come_now_and_then_come_as_often_as_they_should() -> None:
    choose = random_faults(1, 0.2, [LineFault.CUT, LineFault.LATE])
    chosen = [choose(number) for number in range(2000)]
    assert 300 < sum(fault is not None for fault in chosen) < 500
    assert set(chosen) == {None, LineFault.CUT, LineFault.LATE}
    assert chosen == [choose(number) for number in range(2000)]


@pytest.mark.integration
def test_a_proxy_process_stands_in_front_of_a_real_address() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        server = await loop.create_server(Answering, "127.0.0.1", 0)
        target = server.sockets[0].getsockname()
        bad = FaultyLine(1, in_turn([None, LineFault.DUPLICATE, LineFault.RESET]), client_timeout_s=0.2)
        proxy = await serve_bad_line(("127.0.0.1", 0), target, bad)
        reader, writer = await asyncio.open_connection(*proxy.sockets[0].getsockname())
        for expected in (b"answer\n", b"answer\nanswer\n"):
            writer.write(b"question\n")
            assert await asyncio.wait_for(reader.readexactly(len(expected)), 10) == expected
        writer.write(b"question\n")
        with pytest.raises((ConnectionResetError, asyncio.IncompleteReadError)):
            await asyncio.wait_for(reader.readexactly(7), 10)
        writer.close()
        for each in (proxy, server):
            each.close()
        assert [injected.number for injected in bad.injected] == [1, 2]

    run(main(), REAL_TIME)


@pytest.mark.integration
def test_the_proxy_is_a_program() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        server = await loop.create_server(Answering, "127.0.0.1", 0)
        host, port = server.sockets[0].getsockname()
        program = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "simulators.serving.proxy", "--listen", "127.0.0.1:0", "--to", f"{host}:{port}",
            "--first", "duplicate", stderr=asyncio.subprocess.PIPE,
        )  # fmt: skip
        assert program.stderr is not None
        ready = (await asyncio.wait_for(program.stderr.readline(), 30)).decode()
        reader, writer = await asyncio.open_connection("127.0.0.1", int(ready.rpartition(" ")[2]))
        writer.write(b"question\n")
        assert await asyncio.wait_for(reader.readexactly(14), 10) == b"answer\nanswer\n"
        writer.close()
        program.terminate()
        await program.wait()
        server.close()

    run(main(), REAL_TIME)
