"""The fence around a line dialogue: no answer is ever taken for the answer to another question."""

import asyncio

import pytest

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.errors import BadAnswer, DriverError, LinkLost, NoAnswer, Refused, WrongIdentity
from drivers.transport.exchange import ANSWER_LIMIT_BYTES, LineExchange, Pace, SyncQuery
from drivers.transport.memory import Line, join
from tests.support.oracle import (
    LINE,
    PACE,
    WHO,
    Oracle,
    check_name,
    now_s,
    once,
    read_value,
    talk,
    truth,
    value,
)

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
            line = LineExchange("oracle", SyncQuery(WHO, check_name), end=end, pace=PACE)

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


@pytest.mark.parametrize("line", [Line(latency_s=1.5), Line.serial(25)], ids=["far away", "slow"])
@pytest.mark.parametrize("answer", [b"4007\n", b""], ids=["answers", "is silent"])
def test_the_time_for_an_answer_runs_from_the_question_however_it_travels(line: Line, answer: bytes) -> None:
    async def main() -> None:
        exchange = LineExchange("oracle", SyncQuery(WHO, check_name), pace=Pace(answer_s=1.0))
        oracle = Oracle(lambda oracle, _question, _truth: oracle.transport.write(answer))
        join(exchange, oracle, line, "oracle")
        with pytest.raises(NoAnswer, match="no answer within 1 s"):
            await value(exchange, 4)
        assert now_s() == 1.0
        assert oracle.heard == [b"4"]

    run(main(), AS_FAST_AS_POSSIBLE)


def test_an_answer_that_is_no_line_is_found_by_its_framing() -> None:
    def counted(received: bytearray) -> tuple[int, int] | None:
        """Answers that begin with their length, in one byte."""
        if not received or len(received) < 1 + received[0]:
            return None
        return 1 + received[0], 1 + received[0]

    class Counting(asyncio.Protocol):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            self.transport = transport

        def data_received(self, data: bytes) -> None:
            assert data == b"4\n"
            assert isinstance(self.transport, asyncio.Transport)
            for part in (b"\x05", b"40", b"\n07"):
                self.transport.write(part)

    async def main() -> None:
        line = LineExchange("oracle", SyncQuery(WHO, check_name), framing=counted, pace=PACE)
        join(line, Counting(), LINE, "oracle")
        assert await line.query(b"4", bytes) == b"\x0540\n07"
        assert await line.query(b"4", bytes) == b"\x0540\n07"

    run(main(), AS_FAST_AS_POSSIBLE)


def test_a_command_that_is_no_line_is_wrapped_and_told_as_it_was_given() -> None:
    class Framed(asyncio.Protocol):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            self.transport = transport

        def data_received(self, data: bytes) -> None:
            assert data in (b"\x02who?\x03", b"\x024\x03")
            assert isinstance(self.transport, asyncio.Transport)
            self.transport.write(b"oracle\n" if b"who" in data else b"forty\n")

    async def main() -> None:
        proof = SyncQuery(b"who?", lambda _: None)
        line = LineExchange("oracle", proof, wrap=lambda command: b"\x02" + command + b"\x03", pace=PACE)
        join(line, Framed(), LINE, "oracle")
        assert await line.query(b"4", bytes) == b"forty"
        with pytest.raises(BadAnswer, match=r"sent '4'; received 'forty'"):
            await line.query(b"4", int)
        assert await line.query(b"4", bytes) == b"forty"

    run(main(), AS_FAST_AS_POSSIBLE)


def test_a_question_waits_until_the_line_is_silent() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        await value(line, 1)
        answered_s = now_s()
        await value(line, 2)
        assert now_s() - answered_s == pytest.approx(PACE.gap_s + LINE.latency_s)

    talk(use)


# Surprises


def test_silence_is_an_error_at_the_deadline_and_tells_what_was_sent() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        with pytest.raises(NoAnswer, match=r"oracle: no answer within 2 s; sent '5'\. Check that the instrument"):
            await value(line, 5)
        assert now_s() == pytest.approx(PACE.answer_s)
        with pytest.raises(NoAnswer, match=r"within 0\.5 s"):
            await line.query(b"6", read_value, answer_s=0.5)

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
    ("message", "error", "received"),
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
    message: bytes, error: type[DriverError], received: str
) -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        with pytest.raises(error, match="sent '5'") as caught:
            await value(line, 5)
        assert caught.value.received == received
        assert await value(line, 6) == 6007
        assert WHO in oracle.heard

    talk(use, once(b"5", lambda oracle, _answer: oracle.say(message)))


def test_a_duplicate_within_the_gap_is_an_error_before_anything_is_sent() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        assert await value(line, 5) == 5007
        with pytest.raises(BadAnswer, match=r"sent unsolicited data; received '5007\\n'\. Nothing was sent"):
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
        with pytest.raises(BadAnswer, match="is not silent within 10 s"):
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
            line.preempt(b"7")

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
        line = LineExchange("oracle", SyncQuery(WHO, check_name))
        line.close()
        with pytest.raises(LinkLost, match="not connected"):
            await value(line, 6)
        with pytest.raises(TypeError):
            line.connection_made(asyncio.BaseTransport())

    run(main())


# Orders, and what cuts in


def test_an_order_that_is_not_answered_is_sent_once_and_left_to_the_read_back() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        assert await line.send_command(b"4", read_value) == 4007
        assert await line.send_command(b"5", read_value) is None
        assert await value(line, 6) == 6007
        assert oracle.heard == [b"4", b"5", WHO, b"6"]

    talk(use, once(b"5", lambda oracle, _answer: None))


def test_an_order_is_not_sent_on_a_line_that_says_something_unasked() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        oracle.say(b"hello\n")
        await asyncio.sleep(1)
        with pytest.raises(BadAnswer, match="Nothing was sent"):
            await line.send_command(b"5", read_value)
        assert oracle.heard == []

    talk(use)


def test_what_cuts_in_goes_out_at_once_ends_the_exchange_under_way_and_fences_the_line() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        asked = asyncio.create_task(value(line, 5))
        await asyncio.sleep(0.1)
        line.preempt(b"stop")
        with pytest.raises(Refused, match="aborted, the instrument is being made safe"):
            await asked
        assert now_s() == pytest.approx(0.1)
        assert await value(line, 6) == 6007
        assert oracle.heard == [b"5", b"stop", WHO, b"6"]

    talk(use, once(b"5", lambda oracle, answer: oracle.say(answer, after_s=0.5)))


def test_what_cuts_in_ends_a_drain_under_way() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        line.mark_out_of_sync()
        asked = asyncio.create_task(value(line, 5))
        await asyncio.sleep(0.1)
        line.preempt(b"stop")
        with pytest.raises(Refused, match="aborted, the instrument"):
            await asked
        assert await value(line, 6) == 6007
        assert oracle.heard == [b"stop", WHO, b"6"]

    talk(use)


def test_an_order_that_waits_while_something_cuts_in_is_not_sent() -> None:
    async def use(line: LineExchange, oracle: Oracle) -> None:
        asked = asyncio.create_task(value(line, 5))
        ordered = asyncio.create_task(line.send_command(b"on", read_value))
        await asyncio.sleep(0.1)
        line.preempt(b"off")
        with pytest.raises(Refused, match="aborted, the instrument"):
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
        line.preempt(b"stop")
        assert await asked == 5007
        assert await value(line, 6) == 6007
        assert oracle.heard == [b"4", b"5", b"stop", WHO, b"6"]

    def play(oracle: Oracle, question: bytes, answer: bytes) -> None:
        if question not in (b"5", b"stop"):
            oracle.say(answer)

    talk(use, play, Pace())
