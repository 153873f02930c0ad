"""A bad line between an instrument and its client: answers that are lost, late, duplicated, truncated or altered.

It takes the place of an instrument at a server, in the same process or in front of a real address
(`simulators.serving.proxy`). Faults follow from a seed, so that every failure is reproducible.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial

import numpy as np

from drivers.transport.tap import Tap


class LineFault(StrEnum):
    """Fault of one answer."""

    SILENCE = "silence"  # it is lost
    DELAY = "delay"  # it is delayed, within the timeout
    LATE = "late"  # it arrives after the timeout
    DUPLICATE = "duplicate"  # it arrives twice
    GARBAGE = "garbage"  # other bytes arrive before it
    CUT = "cut"  # it is truncated
    SPLIT = "split"  # it arrives byte by byte
    FLIP = "flip"  # one bit is inverted
    ECHO = "echo"  # the query is echoed before it
    RESET = "reset"  # the connection is cut instead
    HALF_OPEN = "half_open"  # no more data on this connection, which stays open
    SLOW_CLOSE = "slow_close"  # it is lost, and the connection is closed some time later


Chooser = Callable[[int], LineFault | None]
"""Selects the fault of an answer, by its number from 0."""

HARMLESS = frozenset({LineFault.DELAY, LineFault.SPLIT})
"""Faults that a client must tolerate without an error."""


@dataclass(frozen=True, slots=True)
class Injected:
    """An injected fault: the number of the answer, the original answer and the altered one."""

    number: int
    fault: LineFault
    answer: bytes
    altered: bytes


@dataclass
class FaultyLine:
    """Applies faults to the answers on a line, and records them.

    `client_timeout_s` is the timeout of the client. `received_data` holds the client's data as received. One object may
    serve several connections in succession: numbering continues.
    """

    seed: int
    choose: Chooser
    client_timeout_s: float = 3.0
    injected: list[Injected] = field(default_factory=list)
    answers: int = 0
    received_data: list[bytes] = field(default_factory=list)

    def server(self, factory: Callable[[], asyncio.Protocol]) -> Callable[[], asyncio.Protocol]:
        """Server whose connections go over this line."""
        return lambda: _FaultyEnd(factory(), self)

    def next(self, answer: bytes, question: bytes) -> tuple[LineFault | None, bytes]:
        """Fault of the next answer, and the answer after it."""
        number, self.answers = self.answers, self.answers + 1
        fault = self.choose(number)
        if fault is None:
            return None, answer
        altered = _altered(fault, answer, question, np.random.default_rng([self.seed, number]))
        self.injected.append(Injected(number, fault, answer, altered))
        return fault, altered


def in_turn(faults: Sequence[LineFault | None]) -> Chooser:
    """Inject these faults into the first answers, then none."""
    return lambda number: faults[number] if number < len(faults) else None


def random_faults(seed: int, share: float, kinds: Sequence[LineFault]) -> Chooser:
    """Inject a fault into this share of the answers, drawn from `kinds`."""

    def choose(number: int) -> LineFault | None:
        draw = np.random.default_rng([seed, 1, number])
        return kinds[int(draw.integers(len(kinds)))] if draw.random() < share else None

    return choose


class _FaultyEnd(Tap):
    """The server's end of a bad line: `inner` is the instrument, whose written data are answers."""

    def __init__(self, inner: asyncio.Protocol, faulty: FaultyLine) -> None:
        super().__init__(inner)
        self._faulty = faulty
        self._question = b""
        self._dead = False

    def received(self, data: bytes) -> None:
        self._question = data
        self._faulty.received_data.append(data)
        if not self._dead:
            super().received(data)

    def sent(self, data: bytes) -> None:
        if self._dead:
            return
        fault, altered = self._faulty.next(data, self._question)
        client_timeout_s = self._faulty.client_timeout_s
        match fault:
            case LineFault.SILENCE:
                pass
            case LineFault.HALF_OPEN:
                self._dead = True
            case LineFault.RESET:
                self.line.abort()
            case LineFault.SLOW_CLOSE:
                self._dead = True
                self._after(client_timeout_s / 2, self.line.close)
            case LineFault.DELAY:
                self._after(client_timeout_s / 2, partial(self._write, altered))
            case LineFault.LATE:
                self._after(client_timeout_s * 1.1, partial(self._write, altered))
            case LineFault.SPLIT:
                for index, byte in enumerate(altered):
                    self._after(index * 0.01 * client_timeout_s / len(altered), partial(self._write, bytes([byte])))
            case _:
                self._write(altered)

    def _write(self, data: bytes) -> None:
        if not self.line.is_closing():
            self.line.write(data)

    def _after(self, delay_s: float, act: Callable[[], object]) -> None:
        asyncio.get_running_loop().call_later(delay_s, act)


def _altered(fault: LineFault, answer: bytes, question: bytes, draw: np.random.Generator) -> bytes:
    match fault:
        case LineFault.DUPLICATE:
            return answer + answer
        case LineFault.GARBAGE:
            return draw.bytes(int(draw.integers(1, 12))) + answer
        case LineFault.CUT:
            return answer[: int(draw.integers(len(answer)))]
        case LineFault.ECHO:
            return question + answer
        case LineFault.FLIP:
            flipped = bytearray(answer)
            flipped[int(draw.integers(len(answer)))] ^= 1 << int(draw.integers(8))
            return bytes(flipped)
        case _:
            return answer
