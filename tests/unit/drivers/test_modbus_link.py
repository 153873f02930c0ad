"""ModbusLink against a server whose every byte is scripted, in virtual time."""

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

import pytest

from bench.loop import AS_FAST_AS_POSSIBLE, BenchLoop, run
from drivers.errors import BadAnswer, CannotConnect, DriverError, LinkLost, NoAnswer, Refused
from drivers.transport.address import Address
from drivers.transport.memory import Line
from drivers.transport.modbus import ModbusLink
from drivers.transport.wires import RealWires

READ_27586 = bytes.fromhex("00 01 00 00 00 06 01 03 6b c2 00 02")
ANSWER_25_C = bytes.fromhex("00 01 00 00 00 07 01 03 04 00 00 41 c8")
WRITE_2782 = bytes.fromhex("00 02 00 00 00 0b 01 10 0a de 00 02 04 00 00 c2 20")
WRITTEN_2782 = bytes.fromhex("00 02 00 00 00 06 01 10 0a de 00 02")
MINUS_40_C = (0x0000, 0xC220)

Script = Callable[[bytes], Sequence[tuple[float, bytes | None]]]


class Server(asyncio.Protocol):
    """Says what `script` answers to a request: bytes after a delay, None to close."""

    def __init__(self, script: Script, requests: list[bytes]) -> None:
        self.script, self.requests = script, requests

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        self.requests.append(data)
        for delay_s, answer in self.script(data):
            act = self.transport.close if answer is None else lambda answer=answer: self.transport.write(answer)
            asyncio.get_running_loop().call_later(delay_s, act)


class Wired:
    """A link and the requests that arrived at its server."""

    def __init__(self, script: Script) -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, BenchLoop)
        self.requests: list[bytes] = []
        loop.serve_in_memory("127.0.0.1", 1502, lambda: Server(script, self.requests), Line(latency_s=0.002))
        self.link = ModbusLink("chamber", RealWires(), Address.parse("tcp://127.0.0.1:1502"), unit_id=1, answer_s=3.0)


def with_server(script: Script, use: Callable[[Wired], Coroutine[Any, Any, None]]) -> None:
    async def main() -> None:
        wired = Wired(script)
        await wired.link.open()
        await use(wired)
        wired.link.close()

    run(main(), AS_FAST_AS_POSSIBLE)


def once(answer: bytes | None) -> Script:
    return lambda _request: [(0.0, answer)]


def elapsed_s() -> float:
    return asyncio.get_running_loop().time()


def test_what_it_sends_and_understands_is_what_the_controller_documents() -> None:
    async def use(wired: Wired) -> None:
        assert await wired.link.read(27586, 2) == (0x0000, 0x41C8)
        await wired.link.write(2782, MINUS_40_C)
        assert wired.requests == [READ_27586, WRITE_2782]

    with_server(lambda request: [(0.0, ANSWER_25_C if request == READ_27586 else WRITTEN_2782)], use)


def test_one_register_is_written_by_function_6() -> None:
    async def use(wired: Wired) -> None:
        await wired.link.write(2796, (57,))
        assert wired.requests == [bytes.fromhex("00 01 00 00 00 06 01 06 0a ec 00 39")]

    with_server(lambda request: [(0.0, request)], use)


def test_an_answer_may_come_in_any_portions() -> None:
    async def use(wired: Wired) -> None:
        assert await wired.link.read(27586, 2) == (0x0000, 0x41C8)

    for cut in range(1, len(ANSWER_25_C)):
        parts = [(0.0, ANSWER_25_C[:cut]), (1.0, ANSWER_25_C[cut:])]
        with_server(lambda _request, parts=parts: parts, use)


def test_a_cut_answer_never_becomes_a_value() -> None:
    async def use(wired: Wired) -> None:
        with pytest.raises(NoAnswer):
            await wired.link.read(27586, 2)
        assert not wired.link.is_open

    for length in range(len(ANSWER_25_C)):
        with_server(once(ANSWER_25_C[:length]), use)


def test_a_server_without_an_answer_is_given_its_time_and_one_request() -> None:
    async def use(wired: Wired) -> None:
        with pytest.raises(NoAnswer, match=r"chamber: no answer within 3 s .* sent read 2 registers at 27586"):
            await wired.link.read(27586, 2)
        assert elapsed_s() == pytest.approx(3.0, abs=0.01)
        assert len(wired.requests) == 1
        assert not wired.link.is_open

    with_server(lambda _request: [], use)


def test_a_late_answer_is_not_taken_for_the_next_one() -> None:
    late = bytes.fromhex("00 01 00 00 00 07 01 03 04 00 00 42 48")  # 50.0, when the first request is long over
    answers = [[(3.5, late)], [(1.0, ANSWER_25_C)]]

    async def use(wired: Wired) -> None:
        with pytest.raises(NoAnswer):
            await wired.link.read(27586, 2)
        await wired.link.open()
        assert await wired.link.read(27586, 2) == (0x0000, 0x41C8)

    with_server(lambda _request: answers.pop(0), use)


def test_an_answer_that_comes_twice_is_not_taken_for_the_next_one() -> None:
    def twice(request: bytes) -> list[tuple[float, bytes]]:
        register = request[8:10]
        answer = request[:4] + bytes.fromhex("00 07 01 03 04 00 00") + register
        return [(0.0, answer), (0.5, answer)]

    async def use(wired: Wired) -> None:
        for register in range(100, 150):
            assert await wired.link.read(register, 2) == (0, register)
            await asyncio.sleep(0.4 if register % 2 else 0.6)

    with_server(twice, use)


@pytest.mark.parametrize(
    "answer",
    [
        "00 00 00 00 00 07 01 03 04 00 00 41 c8",  # transaction 0
        "00 01 00 00 00 05 01 03 02 41 c8",  # one register for two
        "00 01 00 00 00 09 01 03 06 00 00 41 c8 00 00",
        "00 01 00 00 00 06 01 10 6b c2 00 02",  # the answer to a write
        "00 01 00 00 00 03 01 90 02",  # the refusal of a write
    ],
)
def test_an_answer_to_something_else_is_told_and_ends_the_trust(answer: str) -> None:
    async def use(wired: Wired) -> None:
        with pytest.raises(BadAnswer, match="does not fit"):
            await wired.link.read(27586, 2)
        assert not wired.link.is_open

    with_server(once(bytes.fromhex(answer)), use)


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        (MINUS_40_C, "00 01 00 00 00 06 01 10 0a e0 00 02"),  # another address
        (MINUS_40_C, "00 01 00 00 00 06 01 10 0a de 00 01"),  # another count
        ((57,), "00 01 00 00 00 06 01 06 0a de 00 27"),  # another value
    ],
)
def test_a_write_is_confirmed_only_by_its_own_echo(words: tuple[int, ...], answer: str) -> None:
    async def use(wired: Wired) -> None:
        with pytest.raises(BadAnswer, match="does not fit"):
            await wired.link.write(2782, words)

    with_server(once(bytes.fromhex(answer)), use)


@pytest.mark.parametrize(
    "answer",
    [
        "00 02 00 00 00 07 01 03 04 00 00 41 c8",  # another transaction
        "00 01 00 00 00 07 02 03 04 00 00 41 c8",  # another unit
        "00 01 00 07 00 07 01 03 04 00 00 41 c8",  # another protocol
        "48 54 54 50 2f 31 2e 31 20 34 30 30",  # HTTP/1.1 400
    ],
)
def test_frames_of_somebody_else_are_no_answer(answer: str) -> None:
    async def use(wired: Wired) -> None:
        with pytest.raises(NoAnswer):
            await wired.link.read(27586, 2)

    with_server(once(bytes.fromhex(answer)), use)


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        (1, "illegal function"),
        (2, "no such register"),
        (3, "illegal value"),
        (4, "device failure"),
        (11, "gateway target did not respond"),
        (99, "unknown"),
    ],
)
def test_an_exception_is_a_refusal_and_the_connection_stays(code: int, reason: str) -> None:
    async def use(wired: Wired) -> None:
        with pytest.raises(Refused, match=rf"Modbus exception {code}, .*{reason}.*; sent write 0000 c220 at 2782"):
            await wired.link.write(2782, MINUS_40_C)
        with pytest.raises(Refused, match=rf"Modbus exception {code}, "):
            await wired.link.read(27586, 2)
        assert wired.link.is_open
        assert len(wired.requests) == 2

    with_server(lambda request: [(0.0, request[:4] + bytes([0, 3, 1, request[7] | 0x80, code]))], use)


def test_a_connection_that_is_closed_during_a_request_is_noticed_at_once() -> None:
    async def use(wired: Wired) -> None:
        with pytest.raises(LinkLost, match="was closed; sent write 0000 c220 at 2782"):
            await wired.link.write(2782, MINUS_40_C)
        assert elapsed_s() < 0.1
        assert len(wired.requests) == 1
        assert not wired.link.is_open

    with_server(once(None), use)


def test_a_connection_that_was_closed_before_a_request_is_told_and_nothing_is_sent() -> None:
    async def use(wired: Wired) -> None:
        with pytest.raises(Refused):
            await wired.link.read(1, 1)
        await asyncio.sleep(2.0)
        assert wired.link.is_open
        with pytest.raises(LinkLost, match="is closed; sent read 2 registers at 27586"):
            await wired.link.read(27586, 2)
        assert not wired.link.is_open
        assert len(wired.requests) == 1

    with_server(lambda request: [(0.0, request[:4] + bytes([0, 3, 1, 0x83, 2])), (1.0, None)], use)


def test_a_connection_closed_before_any_request_is_told_too() -> None:
    class Closing(asyncio.Protocol):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            transport.close()

    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, BenchLoop)
        unhandled: list[object] = []
        loop.set_exception_handler(lambda _loop, context: unhandled.append(context))
        loop.serve_in_memory("127.0.0.1", 1502, Closing, Line(latency_s=0.002))
        link = ModbusLink("chamber", RealWires(), Address.parse("tcp://127.0.0.1:1502"), unit_id=1)
        await link.open()
        await asyncio.sleep(1.0)
        with pytest.raises(LinkLost):
            await link.read(27586, 2)
        del link
        assert unhandled == []

    run(main(), AS_FAST_AS_POSSIBLE)


def test_a_cancelled_request_ends_the_trust_and_stays_cancelled() -> None:
    async def use(wired: Wired) -> None:
        asking = asyncio.create_task(wired.link.write(2782, MINUS_40_C))
        await asyncio.sleep(0.5)
        asking.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asking
        assert not wired.link.is_open
        with pytest.raises(LinkLost):
            await wired.link.read(27586, 2)

    with_server(lambda _request: [(1.0, WRITTEN_2782)], use)


@pytest.mark.parametrize("after_ms", range(7))
def test_a_cancellation_that_comes_with_the_answer_is_not_lost(after_ms: int) -> None:
    async def use(wired: Wired) -> None:
        async def ask_for_ever() -> None:
            while True:
                await wired.link.read(27586, 2)

        asking = asyncio.create_task(ask_for_ever())
        await asyncio.sleep(after_ms / 1000)
        asking.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asyncio.wait_for(asking, 1.0)

    with_server(lambda request: [(0.0, request[:2] + ANSWER_25_C[2:])], use)


def test_a_cancelled_connect_stays_cancelled_and_leaves_nothing_open() -> None:
    async def main() -> None:
        wired = Wired(lambda _request: [])
        opening = asyncio.create_task(wired.link.open())
        await asyncio.sleep(0.001)
        opening.cancel()
        with pytest.raises(asyncio.CancelledError):
            await opening
        assert not wired.link.is_open

    run(main(), AS_FAST_AS_POSSIBLE)


def test_a_connect_that_hangs_is_given_up() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, BenchLoop)
        loop.serve_in_memory("127.0.0.1", 1502, asyncio.Protocol, Line(latency_s=60.0))
        link = ModbusLink("chamber", RealWires(), Address.parse("tcp://127.0.0.1:1502"), unit_id=1, answer_s=3.0)
        with pytest.raises(CannotConnect):
            await link.open()
        assert elapsed_s() == pytest.approx(3.0)

    run(main(), AS_FAST_AS_POSSIBLE)


def test_closing_twice_is_harmless_and_nothing_goes_out_before_opening() -> None:
    async def use(wired: Wired) -> None:
        wired.link.close()
        wired.link.close()
        with pytest.raises(LinkLost):
            await wired.link.read(27586, 2)
        assert wired.requests == []

    with_server(lambda _request: [], use)


def test_nobody_at_the_address_is_told() -> None:
    class Elsewhere(BenchLoop):
        async def create_connection(self, *_: Any, **__: Any) -> Any:
            raise ConnectionRefusedError

    async def main() -> None:
        link = ModbusLink("chamber", RealWires(), Address.parse("tcp://127.0.0.1:1502"), unit_id=1)
        with pytest.raises(CannotConnect, match=r"no connection to tcp://.* Check that the instrument is on"):
            await link.open()
        assert not link.is_open

    with asyncio.Runner(loop_factory=lambda: Elsewhere(AS_FAST_AS_POSSIBLE)) as runner:
        runner.run(main())


def test_every_error_names_the_device() -> None:
    async def use(wired: Wired) -> None:
        with pytest.raises(DriverError) as reported:
            await wired.link.read(27586, 2)
        assert reported.value.device == "chamber"

    for answer in (None, ANSWER_25_C[:-2], bytes.fromhex("00 01 00 00 00 03 01 83 02")):
        with_server(once(answer), use)


def test_the_time_for_an_answer_runs_from_the_request_however_slow_the_line_is() -> None:
    class AtOnce(Server):
        def data_received(self, data: bytes) -> None:
            self.transport.write(ANSWER_25_C)

    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, BenchLoop)
        line = Line(byte_s=0.2)  # 2.4 s for the request, 2.6 s for the answer
        loop.serve_in_memory("127.0.0.1", 1502, lambda: AtOnce(once(None), []), line)
        link = ModbusLink("chamber", RealWires(), Address.parse("tcp://127.0.0.1:1502"), unit_id=1, answer_s=3.0)
        await link.open()
        with pytest.raises(NoAnswer, match="no answer within 3 s"):
            await link.read(27586, 2)
        assert elapsed_s() == 3.0
        link.close()

    run(main(), AS_FAST_AS_POSSIBLE)
