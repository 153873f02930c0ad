"""A campaign of faults on a line: every one is reported, no value is wrong; a naive client is the control."""

import asyncio
import random

import pytest

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.errors import DriverError
from drivers.transport.exchange import LineExchange
from tests.support.memory_stream import open_memory_stream
from tests.support.oracle import (
    LINE,
    PACE,
    WHO,
    Oracle,
    Play,
    read_value,
    talk,
    truth,
    value,
)


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
