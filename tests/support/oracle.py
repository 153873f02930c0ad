"""An instrument that answers every number with one value, so that an answer to another question shows."""

import asyncio
from collections.abc import Awaitable, Callable

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.errors import WrongIdentity
from drivers.transport.exchange import LineExchange, Pace, SyncQuery, printable
from drivers.transport.memory import Line, join

PACE = Pace(answer_s=2.0, quiet_s=1.0, gap_s=0.02)
WHO, NAME = b"who?", b"the oracle"
LINE = Line(latency_s=0.001)


def truth(question: int) -> int:
    return question * 1000 + 7


def read_value(line: bytes) -> int:
    text = line.decode("ascii")
    if not text.isdigit():
        raise ValueError("not a number")
    return int(text)


def check_name(line: bytes) -> None:
    if line != NAME:
        raise WrongIdentity("oracle", "is another", received=printable(line))


class Oracle(asyncio.Protocol):
    """Answers `n` with truth(n) and `who?` with its name, unless `play` is there to answer instead."""

    def __init__(self, play: Callable[["Oracle", bytes, bytes], None] | None = None) -> None:
        self._play = play or (lambda oracle, _question, answer: oracle.say(answer))
        self._rest = b""
        self.heard: list[bytes] = []
        self.transport: asyncio.Transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        *questions, self._rest = (self._rest + data).split(b"\n")
        for question in questions:
            self.heard.append(question)
            answer = NAME if question == WHO else str(truth(int(question))).encode() if question.isdigit() else b""
            self._play(self, question, answer + b"\n")

    def say(self, data: bytes, after_s: float = 0.0) -> None:
        asyncio.get_running_loop().call_later(after_s, self.transport.write, data)


Play = Callable[[Oracle, bytes, bytes], None]


def talk(use: Callable[[LineExchange, Oracle], Awaitable[None]], play: Play | None = None, pace: Pace = PACE) -> None:
    """Run `use` in virtual time on an exchange with an oracle."""

    async def main() -> None:
        line, oracle = LineExchange("oracle", SyncQuery(WHO, check_name), pace=pace), Oracle(play)
        join(line, oracle, LINE, "oracle")
        await use(line, oracle)

    run(main(), AS_FAST_AS_POSSIBLE)


def once(question: bytes, act: Callable[[Oracle, bytes], None]) -> Play:
    """Play `act` for the first time that a question comes, and the truth otherwise."""

    def play(oracle: Oracle, asked: bytes, answer: bytes) -> None:
        if asked == question and oracle.heard.count(question) == 1:
            act(oracle, answer)
        else:
            oracle.say(answer)

    return play


async def value(line: LineExchange, question: int) -> int:
    return await line.query(str(question).encode(), read_value)


def now_s() -> float:
    return asyncio.get_running_loop().time()
