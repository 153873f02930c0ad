"""The conversation with a SCPI instrument: identity, writes with their errors, and a lost wire."""

import asyncio
import re
from collections.abc import Awaitable, Callable
from types import SimpleNamespace
from typing import Any

import pytest

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.description import IdentityPin, Nothing, Setup, ignore_note
from drivers.errors import LinkLost, Refused, WrongIdentity
from drivers.transport.address import Address
from drivers.transport.scpi import MAX_ERRORS, ScpiLink
from drivers.values import Identity
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.scpi import OUT_OF_RANGE, Interpreter, LineSession, setting
from tests.support.lines import TappedWire


def an_interpreter(**settings: Any) -> Interpreter:
    levels = [0.0]

    def set_level(argument: str) -> None:
        levels[0] = setting(argument, 0, 16)

    return Interpreter("A,B,C,D", {"VOLTage": set_level, "VOLTage?": lambda _: f"{levels[0]:g}"}, **settings)


class Stubborn:
    """An instrument whose error queue never becomes empty."""

    faults = FaultPlan()

    def session(self) -> LineSession:
        return LineSession(lambda message: "A,B,C,D" if "IDN" in message else '-350,"Queue overflow"')


def with_link(
    use: Callable[[ScpiLink, TappedWire, Interpreter], Awaitable[None]], pin: IdentityPin | None = None,
    note: Callable[[str], object] = ignore_note, **settings: Any,
) -> None:  # fmt: skip
    async def main() -> None:
        interpreter = an_interpreter(**settings)
        instrument = SimpleNamespace(faults=FaultPlan(), session=lambda: LineSession(interpreter.execute))
        wire = TappedWire(instrument)
        await use(a_link(wire, pin, note), wire, interpreter)

    run(main(), AS_FAST_AS_POSSIBLE)


def a_link(
    wire: TappedWire, pin: IdentityPin | None = None, note: Callable[[str], object] = ignore_note
) -> ScpiLink:  # fmt: skip
    address = Address.parse("tcp://127.0.0.1:5025")
    return ScpiLink(Setup("supply", address, wire, Nothing(), Nothing(), Nothing(), pin or IdentityPin(), note=note))


def test_opening_identifies_and_empties_the_error_queue() -> None:
    async def use(link: ScpiLink, wire: TappedWire, interpreter: Interpreter) -> None:
        interpreter.note(OUT_OF_RANGE)
        await link.open()
        await link.write("VOLT 5")
        assert await link.identify() == Identity("A", "B", "C", "D")
        assert wire.requests == [
            b"*IDN?\n", b":SYST:ERR?\n", b":SYST:ERR?\n", b"VOLT 5;:SYST:ERR?\n", b"*IDN?\n",
        ]  # fmt: skip

    with_link(use)


def test_a_refused_write_names_every_error_and_leaves_none() -> None:
    async def use(link: ScpiLink, wire: TappedWire, interpreter: Interpreter) -> None:
        await link.open()
        with pytest.raises(Refused, match=r'sent VOLT 17;:CUR 1; received -222,"Data.*"; -113,"Undefined header"'):
            await link.write("VOLT 17;:CUR 1")
        assert interpreter.execute("SYST:ERR?") == '0,"No error"'

    with_link(use)


@pytest.mark.parametrize(
    ("known", "asked", "reported"),
    [
        (("STATus:ERRor?",), b":STAT:ERR?", '-222,"Data out of range"'),
        ((), b"*ESR?", '-200,"Execution error, *ESR? is 16"'),
    ],
)
def test_an_instrument_that_does_not_know_the_usual_question_for_errors_is_asked_another(
    known: tuple[str, ...], asked: bytes, reported: str
) -> None:
    notes: list[str] = []

    async def use(link: ScpiLink, wire: TappedWire, interpreter: Interpreter) -> None:
        await link.open()
        assert notes[-1] == f"it does not answer :SYST:ERR?; its errors are queried by {asked.decode()}"
        assert all(note.startswith("asked again: ") for note in notes[:-1])
        await link.write("VOLT 5")  # the questions that it did not know are forgotten
        with pytest.raises(Refused, match=re.escape(f"received {reported}.")):
            await link.write("VOLT 20")
        wire.drop()
        await asyncio.sleep(1.0)
        await link.reopen()
        assert wire.count(b":SYST:ERR?") == 2
        assert wire.requests[-1] == asked + b"\n"

    with_link(use, note=notes.append, error_queries=known)


def test_a_question_for_errors_whose_answer_is_lost_is_asked_again() -> None:
    async def use(link: ScpiLink, wire: TappedWire, interpreter: Interpreter) -> None:
        wire.lose = lambda _request: len(wire.requests) == 2
        await link.open()
        await link.write("VOLT 5")
        assert wire.requests[-1] == b"VOLT 5;:SYST:ERR?\n"
        assert [note[:12] for note in notes] == ["asked again:"]

    notes: list[str] = []
    with_link(use, note=notes.append)


def test_a_write_without_an_answer_is_left_to_the_read_back() -> None:
    async def use(link: ScpiLink, wire: TappedWire, interpreter: Interpreter) -> None:
        await link.open()
        wire.mute(b"VOLT 5")
        await link.write("VOLT 5")
        assert wire.count(b"VOLT 5") == 1
        assert interpreter.execute("VOLT?") == "5"

    with_link(use)


def test_an_error_queue_without_end_is_refused() -> None:
    async def main() -> None:
        wire = TappedWire(Stubborn())
        with pytest.raises(Refused, match="does not become empty"):
            await a_link(wire).open()
        await asyncio.sleep(0.1)
        assert wire.count(b"ERR") == MAX_ERRORS
        assert wire.connections[0].transport is not None
        assert wire.connections[0].transport.is_closing()

    run(main(), AS_FAST_AS_POSSIBLE)


def test_another_instrument_is_refused() -> None:
    async def use(link: ScpiLink, wire: TappedWire, interpreter: Interpreter) -> None:
        with pytest.raises(WrongIdentity, match="serial is 'C', the bench file says 'E'"):
            await link.open()

    with_link(use, IdentityPin(serial="E"))


def test_an_instrument_that_takes_the_place_of_another_is_refused() -> None:
    async def use(link: ScpiLink, wire: TappedWire, interpreter: Interpreter) -> None:
        await link.open()
        wire.alter = lambda request, answer: answer.replace(b"A,B,C", b"A,B,X")
        with pytest.raises(WrongIdentity, match=r"another instrument has taken its place; received A,B,X,D"):
            await link.identify()
        wire.drop()
        await asyncio.sleep(0.1)
        with pytest.raises(WrongIdentity):
            await link.reopen()

    with_link(use)


def test_a_lost_wire_is_opened_again_once() -> None:
    async def use(link: ScpiLink, wire: TappedWire, interpreter: Interpreter) -> None:
        with pytest.raises(LinkLost, match="is not connected"):
            await link.identify()
        link.close()
        await link.reopen()
        await link.reopen()
        assert len(wire.connections) == 1
        wire.drop()
        await asyncio.sleep(0.1)
        assert (await link.identify()).serial == "C"
        assert len(wire.connections) == 2
        link.close()
        link.close()
        with pytest.raises(LinkLost, match="closed by this program"):
            await link.identify()
        assert len(wire.connections) == 2

    with_link(use)
