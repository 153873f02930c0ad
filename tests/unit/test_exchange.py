"""The fence around a line dialogue: no answer is ever taken for the answer to another question."""

import asyncio
import random
from collections.abc import Awaitable, Callable

import pytest

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.errors import BadAnswer, DriverError, LinkLost, NoAnswer, Refused, WrongIdentity
from drivers.transport.exchange import ANSWER_LIMIT_BYTES, LineExchange, Pace, Proof, printable
from drivers.transport.memory import Line, join, open_memory_stream

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
    """Runs `use` in virtual time on an exchange with an oracle."""

    async def main() -> None:
        line, oracle = LineExchange("oracle", Proof(WHO, check_name), pace=pace), Oracle(play)
        join(line, oracle, LINE, "oracle")
        await use(line, oracle)

    run(main(), AS_FAST_AS_POSSIBLE)


def once(question: bytes, act: Callable[[Oracle, bytes], None]) -> Play:
    """Plays `act` for the first time that a question comes, and the truth otherwise."""

    def play(oracle: Oracle, asked: bytes, answer: bytes) -> None:
        if asked == question and oracle.heard.count(question) == 1:
            act(oracle, answer)
        else:
            oracle.say(answer)

    return play


async def value(line: LineExchange, question: int) -> int:
    return await line.ask(str(question).encode(), read_value)


def now_s() -> float:
    return asyncio.get_running_loop().time()


# Good exchanges


def test_an_answer_is_read() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        assert [await value(line, n) for n in (1, 2, 3)] == [1007, 2007, 3007]
        assert oracle.heard == [b"1", b"2", b"3"]

    talk(use)


def test_callers_take_turns() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        assert await asyncio.gather(*(value(line, n) for n in range(9))) == [truth(n) for n in range(9)]

    talk(use)


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
def test_an_answer_may_come_split_at_every_byte(end: bytes) -> None:
    async def main() -> None:
        answer = b"4007" + end
        for cut in range(len(answer) + 1):
            line = LineExchange("oracle", Proof(WHO, check_name), end=end, pace=PACE)

            class Slow(asyncio.Protocol):
                def connection_made(self, transport: asyncio.BaseTransport) -> None:
                    self.transport = transport

                def data_received(self, data: bytes, cut: int = cut) -> None:
                    assert data == b"4" + end
                    assert isinstance(self.transport, asyncio.Transport)
                    self.transport.write(answer[:cut])
                    asyncio.get_running_loop().call_later(0.5, self.transport.write, answer[cut:])

            join(line, Slow(), LINE, "oracle")
            assert await value(line, 4) == 4007

    run(main(), AS_FAST_AS_POSSIBLE)


def test_a_question_waits_until_the_line_is_silent() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        await value(line, 1)
        answered_s = now_s()
        await value(line, 2)
        assert now_s() - answered_s == pytest.approx(PACE.gap_s + 2 * LINE.latency_s)

    talk(use)


# Surprises


def test_silence_is_an_error_at_the_deadline_and_tells_what_was_sent() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        with pytest.raises(NoAnswer, match=r"oracle: no answer within 2 s; sent '5'\. Check that the instrument"):
            await value(line, 5)
        assert now_s() == pytest.approx(PACE.answer_s)
        with pytest.raises(NoAnswer, match=r"within 0\.5 s"):
            await line.ask(b"6", read_value, answer_s=0.5)

    talk(use, lambda oracle, question, answer: oracle.say(answer) if question == WHO else None)


def test_a_late_answer_is_drained_and_the_instrument_identified_before_the_next_question() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        with pytest.raises(NoAnswer):
            await value(line, 5)
        assert await value(line, 6) == 6007
        assert oracle.heard == [b"5", WHO, b"6"]

    talk(use, once(b"5", lambda oracle, answer: oracle.say(answer, after_s=2.5)))


def test_an_answer_later_than_the_drain_is_not_taken_for_the_proof() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        with pytest.raises(NoAnswer):
            await value(line, 5)
        with pytest.raises(WrongIdentity, match="5007"):
            await value(line, 6)
        assert await value(line, 6) == 6007
        assert oracle.heard == [b"5", WHO, WHO, b"6"]

    talk(use, once(b"5", lambda oracle, answer: oracle.say(answer, after_s=2.9995)))


@pytest.mark.parametrize(
    ("said", "error", "received"),
    [
        pytest.param(b"5007\n5007\n", BadAnswer, r"'5007' then '5007\n'", id="a duplicate at once"),
        pytest.param(b"5007\nready\n", BadAnswer, r"'5007' then 'ready\n'", id="an extra line"),
        pytest.param(b"5007\n5", BadAnswer, "'5007' then '5'", id="an extra byte"),
        pytest.param(b"5\n5007\n", BadAnswer, r"'5' then '5007\n'", id="an echo"),
        pytest.param(b"5o07\n", BadAnswer, "'5o07'", id="a letter in the number"),
        pytest.param(b"\xff\xfe\n", BadAnswer, r"'\xff\xfe'", id="garbage"),
        pytest.param(b"\n", BadAnswer, "''", id="an empty line"),
        pytest.param(b"5007", NoAnswer, "'5007'", id="no terminator"),
        pytest.param(b"5007\r", NoAnswer, r"'5007\r'", id="another terminator"),
        pytest.param(b"500", NoAnswer, "'500'", id="the end cut off"),
        pytest.param(b"", NoAnswer, "", id="nothing"),
    ],
)
def test_what_is_not_one_whole_answer_is_an_error_and_the_next_value_is_right(
    said: bytes, error: type[DriverError], received: str
) -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        with pytest.raises(error, match="sent '5'") as caught:
            await value(line, 5)
        assert caught.value.received == received
        assert await value(line, 6) == 6007
        assert WHO in oracle.heard

    talk(use, once(b"5", lambda oracle, _answer: oracle.say(said)))


def test_a_duplicate_within_the_gap_is_an_error_before_anything_is_sent() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        assert await value(line, 5) == 5007
        with pytest.raises(BadAnswer, match=r"said something unasked; received '5007\\n'\. Nothing was sent"):
            await value(line, 6)
        assert oracle.heard == [b"5"]
        assert await value(line, 6) == 6007

    def twice(oracle: Oracle, answer: bytes) -> None:
        oracle.say(answer)
        oracle.say(answer, after_s=0.015)

    talk(use, once(b"5", twice))


def test_cancelling_an_exchange_leaves_no_answer_behind() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        asked = asyncio.create_task(value(line, 5))
        await asyncio.sleep(0.1)
        asked.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asked
        assert await value(line, 6) == 6007
        assert oracle.heard == [b"5", WHO, b"6"]

    talk(use, once(b"5", lambda oracle, answer: oracle.say(answer, after_s=0.2)))


def test_an_answer_without_an_end_is_refused() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        with pytest.raises(BadAnswer, match=r"an answer without an end.*bytes"):
            await value(line, 5)

    talk(use, once(b"5", lambda oracle, _answer: oracle.say(b"x" * (ANSWER_LIMIT_BYTES + 1))))


def test_an_instrument_that_does_not_stop_talking_is_not_trusted() -> None:
    def chatter(oracle: Oracle, _answer: bytes) -> None:
        for tenth in range(300):
            oracle.say(b"1", after_s=0.1 * tenth)

    async def use(line: LineExchange, oracle: Oracle) -> None:
        with pytest.raises(NoAnswer):
            await value(line, 5)
        with pytest.raises(BadAnswer, match="does not stop talking within 10 s"):
            await value(line, 6)
        await asyncio.sleep(20)
        assert await value(line, 6) == 6007

    talk(use, once(b"5", chatter))


def test_a_lost_connection_ends_the_wait_at_once_and_for_good() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        assert not line.lost
        with pytest.raises(LinkLost, match="the connection was closed"):
            await value(line, 5)
        assert now_s() < 0.1
        assert line.lost
        for _ in range(2):
            with pytest.raises(LinkLost):
                await value(line, 6)
        with pytest.raises(LinkLost):
            line.cut_in(b"7")

    talk(use, once(b"5", lambda oracle, _answer: oracle.transport.abort()))


def test_a_closed_line_says_who_closed_it() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        line.close()
        line.close()
        with pytest.raises(LinkLost, match=r"closed by this program; sent '6'"):
            await value(line, 6)

    talk(use)


def test_before_it_has_a_transport_it_is_not_connected() -> None:
    async def main() -> None:
        line = LineExchange("oracle", Proof(WHO, check_name))
        line.close()
        with pytest.raises(LinkLost, match="not connected"):
            await value(line, 6)
        with pytest.raises(TypeError):
            line.connection_made(asyncio.BaseTransport())

    run(main())


# Orders, and what cuts in


def test_an_order_that_is_not_answered_is_sent_once_and_left_to_the_read_back() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        assert await line.order(b"4", read_value) == 4007
        assert await line.order(b"5", read_value) is None
        assert await value(line, 6) == 6007
        assert oracle.heard == [b"4", b"5", WHO, b"6"]

    talk(use, once(b"5", lambda oracle, _answer: None))


def test_an_order_is_not_sent_on_a_line_that_says_something_unasked() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        oracle.say(b"hello\n")
        await asyncio.sleep(1)
        with pytest.raises(BadAnswer, match="Nothing was sent"):
            await line.order(b"5", read_value)
        assert oracle.heard == []

    talk(use)


def test_what_cuts_in_goes_out_at_once_ends_the_exchange_under_way_and_fences_the_line() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        asked = asyncio.create_task(value(line, 5))
        await asyncio.sleep(0.1)
        line.cut_in(b"stop")
        with pytest.raises(Refused, match="cut short, the instrument is being made safe"):
            await asked
        assert now_s() == pytest.approx(0.1)
        assert await value(line, 6) == 6007
        assert oracle.heard == [b"5", b"stop", WHO, b"6"]

    talk(use, once(b"5", lambda oracle, answer: oracle.say(answer, after_s=0.5)))


def test_what_cuts_in_ends_a_drain_under_way() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        line.distrust()
        asked = asyncio.create_task(value(line, 5))
        await asyncio.sleep(0.1)
        line.cut_in(b"stop")
        with pytest.raises(Refused, match="cut short"):
            await asked
        assert await value(line, 6) == 6007
        assert oracle.heard == [b"stop", WHO, b"6"]

    talk(use)


def test_an_order_that_waits_while_something_cuts_in_is_not_sent() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        asked = asyncio.create_task(value(line, 5))
        ordered = asyncio.create_task(line.order(b"on", read_value))
        await asyncio.sleep(0.1)
        line.cut_in(b"off")
        with pytest.raises(Refused, match="cut short"):
            await asked
        with pytest.raises(Refused, match="not sent, the instrument is being made safe; sent 'on'"):
            await ordered
        assert oracle.heard == [b"5", b"off", WHO]

    talk(use, once(b"5", lambda oracle, answer: oracle.say(answer, after_s=0.5)))


def test_an_answer_that_comes_as_something_cuts_in_does_not_lift_the_fence() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        await value(line, 4)
        asked = asyncio.create_task(value(line, 5))
        await asyncio.sleep(0.001)
        line.data_received(b"5007\n")
        line.cut_in(b"stop")
        assert await asked == 5007
        assert await value(line, 6) == 6007
        assert oracle.heard == [b"4", b"5", b"stop", WHO, b"6"]

    def play(oracle: Oracle, question: bytes, answer: bytes) -> None:
        if question not in (b"5", b"stop"):
            oracle.say(answer)

    talk(use, play, Pace())


# A campaign of faults, with a naive client as control


def late(oracle: Oracle, answer: bytes, draw: random.Random) -> None:
    oracle.say(answer, after_s=draw.uniform(PACE.answer_s + 0.01, PACE.answer_s + PACE.quiet_s - 0.01))


def lost(oracle: Oracle, answer: bytes, draw: random.Random) -> None:
    pass


def partial(oracle: Oracle, answer: bytes, draw: random.Random) -> None:
    oracle.say(answer[: draw.randrange(len(answer))])


def garbage(oracle: Oracle, answer: bytes, draw: random.Random) -> None:
    oracle.say(draw.randbytes(draw.randrange(1, 20)).translate(None, b"0123456789\n") + b"?\n")


def duplicate(oracle: Oracle, answer: bytes, draw: random.Random) -> None:
    oracle.say(answer)
    oracle.say(answer, after_s=draw.uniform(0, PACE.gap_s * 0.9))


def echo(oracle: Oracle, answer: bytes, draw: random.Random) -> None:
    oracle.say(oracle.heard[-1] + b"\n" + answer)


def error_text(oracle: Oracle, answer: bytes, draw: random.Random) -> None:
    oracle.say(b"ERR 5\n")


FAULTS = [late, lost, partial, garbage, duplicate, echo, error_text]
REQUESTS = 5000


def faulty(draw: random.Random, injected: list[str], *, also_proofs: bool = False) -> Play:
    def play(oracle: Oracle, question: bytes, answer: bytes) -> None:
        if draw.random() < 0.2 and (also_proofs or question != WHO):
            fault = draw.choice(FAULTS)
            injected.append(fault.__name__)
            fault(oracle, answer, draw)
        else:
            oracle.say(answer)

    return play


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_of_a_thousand_faults_every_one_is_reported_and_no_value_is_wrong(seed: int) -> None:
    injected: list[str] = []
    wrong, errors = [], []

    async def use(line: LineExchange, oracle: Oracle) -> None:
        for question in range(REQUESTS):
            try:
                found = await value(line, question)
            except DriverError as problem:
                errors.append(problem)
            else:
                if found != truth(question):
                    wrong.append(question)

    talk(use, faulty(random.Random(seed), injected))
    assert wrong == []
    assert len(injected) > 900
    assert set(injected) == {fault.__name__ for fault in FAULTS}
    assert len(errors) in (len(injected), len(injected) - 1)  # a duplicate after the last question is seen by nobody


def test_no_value_is_wrong_when_the_proofs_fail_too() -> None:
    injected: list[str] = []
    wrong, right = [], []

    async def use(line: LineExchange, oracle: Oracle) -> None:
        for question in range(REQUESTS):
            try:
                found = await value(line, question)
            except DriverError:
                continue
            (right if found == truth(question) else wrong).append(question)

    talk(use, faulty(random.Random(4), injected, also_proofs=True))
    assert wrong == []
    assert len(right) > 0.7 * REQUESTS
    assert len(injected) > 1000


def test_a_client_without_a_fence_stores_wrong_values() -> None:
    wrong: list[int] = []

    async def main() -> None:
        play = faulty(random.Random(1), [])
        reader, writer = open_memory_stream(lambda: Oracle(play), LINE, "oracle")
        for question in range(REQUESTS):
            writer.write(b"%d\n" % question)
            try:
                async with asyncio.timeout(PACE.answer_s):
                    found = read_value((await reader.readline()).rstrip(b"\n"))
            except (TimeoutError, ValueError):
                continue
            if found != truth(question):
                wrong.append(question)
        writer.close()

    run(main(), AS_FAST_AS_POSSIBLE)
    assert len(wrong) > REQUESTS / 2
