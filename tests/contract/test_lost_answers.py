"""One answer is lost: what only reads is asked again, which the journal hears of, and no order is sent twice."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import pytest

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.errors import DriverError
from drivers.transport.dialogue import Dialogue
from simulators.faults.line_faults import FaultyLine, LineFault
from tests.support.every_driver import EVERY, Call, Opened, calls_of

ASKS_NOTHING = frozenset({"can_counter", "can_telemetry"})
WITHOUT_ANSWERS = frozenset({"acquire", "wait_for_data"})
INSTEAD: Mapping[str, Call] = {"ramp_to": lambda d: d.ramp_to(20.6, 1.0)}  # a short way will do
OF_DRIVER: Mapping[str, Mapping[str, Call]] = {"fluke_5700a": {"set": lambda d: d.set(1e-3, limit=10.0, output=True)}}
asking_driver = pytest.mark.parametrize("driver", sorted(EVERY.keys() - ASKS_NOTHING))


def _text(answer: bytes) -> bool:
    return all(b"?" in part for part in re.split(rb"[;\r\n]+", answer.strip()))


def _begins(*beginnings: bytes) -> Callable[[bytes], bool]:
    return lambda answer: answer.startswith(beginnings)


_RTU = re.compile(rb"(?s).[\x03\x04]")
_TCP = re.compile(rb"(?s).{7}[\x03\x04]")
ASKS: Mapping[str, Callable[[bytes], object]] = {
    "aerotech_ensemble": _begins(b"GETPARM", b"PFBK", b"AXISFAULT", b"AXISSTATUS"),
    "agilent_34970a": lambda answer: _text(answer) or answer.startswith(b":INIT;"),  # a scan changes no setting
    "binder": _RTU.match,
    "cts": lambda answer: answer[2:3] in (b"\xc1", b"\xc3", b"\xd2", b"\xd3"),  # A, C, R, S
    "framed_head": lambda answer: answer[2] == 0x10,
    "framed_table": lambda answer: answer[2] == 0x10,
    "keysight_3458a": lambda answer: _text(answer) or answer.startswith((b"TARM SGL", b"TARM HOLD;END ALWAYS;ID?")),
    "modbus_chamber": _TCP.match,
    "newport_xps": re.compile(rb"\w+(?:Get|Read)\(").match,
    "simserv": _begins(
        b"99997", b"11023", b"11007", b"11009", b"11004", b"11002", b"10012", b"19210", b"11066", b"11070"
    ),
    "watlow_f4": _RTU.match,
    "watlow_f4t": _TCP.match,
}  # fmt: skip
ASKS = ASKS | {"keysight_3458a_ammeter": ASKS["keysight_3458a"]}


def asks(driver: str, answer: bytes) -> bool:
    """Whether what was said to an instrument only reads."""
    return bool(ASKS.get(driver, _text)(answer))


def meaning(driver: str, answer: bytes) -> bytes:
    """What was said without the number that each message has of its own."""
    if ASKS.get(driver) is _TCP.match:
        return answer[2:]
    return answer[:3] + answer[4:-2] if driver.startswith("framed") else answer


async def received_while(driver: str, call: Call, lost: int) -> tuple[list[bytes], list[str], DriverError | None]:
    """What an instrument hears while it is opened and called, its answer of this number lost; notes, and the error."""
    bad, reported = FaultyLine(1, lambda number: LineFault.SILENCE if number == lost else None), list[str]()
    problem = None
    device: Any = Opened(driver, bad).driver(reported.append)
    try:
        async with device:
            await call(device)
    except DriverError as found:
        problem = found
    assert len(bad.injected) == (lost >= 0)
    return bad.received_data, reported, problem


async def problems_of(driver: str, name: str, call: Call) -> list[str]:
    """What is wrong when each message to an instrument has its first answer lost, one at a time."""
    answer, _, problem = await received_while(driver, call, -1)
    assert problem is None
    whole = Counter(meaning(driver, each) for each in answer if not asks(driver, each))
    firsts = {}
    answered = 0
    for each in answer:
        firsts.setdefault(meaning(driver, each), (answered, each))
        answered += not (driver.startswith("framed") and not asks(driver, each))  # its orders have no answer
    found = []
    for lost, message in firsts.values():
        is_question, where = asks(driver, message), f"{name}: the answer to {message!r} was lost"
        if not is_question and driver.startswith("framed"):
            continue
        received, reported, problem = await received_while(driver, call, lost)
        orders = Counter(meaning(driver, each) for each in received if not asks(driver, each))
        found += [f"{where}: {order!r} was sent again" for order in orders if orders[order] > max(whole[order], 1)]
        if is_question and problem is not None:
            found.append(f"{where}: {problem}")
        if is_question and not reported:
            found.append(f"{where}: nobody was told")
    return found


def play(driver: str) -> list[str]:
    calls = {name: INSTEAD.get(name, call) for name, call in calls_of(driver).items() if name not in WITHOUT_ANSWERS}
    calls |= OF_DRIVER.get(driver, {})

    async def main() -> list[str]:
        return [problem for name, call in calls.items() for problem in await problems_of(driver, name, call)]

    return run(main(), AS_FAST_AS_POSSIBLE)


@asking_driver
def test_a_lost_answer_costs_one_more_question_and_no_second_order(driver: str) -> None:
    assert play(driver) == []


# Bugs that were planted: the table has to find each


def test_a_driver_that_does_not_ask_again_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Dialogue, "query", Dialogue.query_once)
    assert any("no answer within" in problem for problem in play("newport_xps"))


def test_a_driver_that_sends_an_order_again_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Dialogue, "query_once", Dialogue.query)
    assert any("LIM:RATE" in problem and "was sent again" in problem for problem in play("acutronic_acl"))
