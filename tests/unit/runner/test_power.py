"""The state of an uninterruptible supply: lines typed from RFC 9271, servers that misbehave, and what a run does."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress

import pytest
from pydantic import ValidationError

from bench.config.power import PowerEntry, Supply
from bench.runner import nut
from bench.runner.nut import Client, PowerState, question, read_status
from bench.runner.power import Hold, Policy

Serve = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]


def test_the_question_is_that_of_the_protocol() -> None:
    assert question("su700") == b"GET VAR su700 ups.status\n"


@pytest.mark.parametrize(
    ("line", "kind"),
    [
        (b'VAR su700 ups.status "OL"\n', "line"),
        (b'VAR su700 ups.status "OL CHRG LB"\n', "line"),
        (b'VAR su700 ups.status "OB DISCHRG"\n', "battery"),
        (b'VAR su700 ups.status "OB LB"\n', "low"),
        (b'VAR su700 ups.status "FSD OL"\n', "low"),
        (b'VAR su700 ups.status "OB \\"LB\\""\n', "battery"),
        (b'VAR su700 ups.status ""\n', "unknown"),
        (b'VAR su700 ups.status "WAIT"\n', "unknown"),
        (b'VAR other ups.status "OB LB"\n', "unknown"),
        (b'VAR su700 ups.status "OB LB" x\n', "unknown"),
        (b'VAR su700 battery.charge "100"\n', "unknown"),
        (b"ERR DATA-STALE\n", "unknown"),
        (b"ERR UNKNOWN-UPS\n", "unknown"),
        (b"\xff\n", "unknown"),
    ],
)
def test_an_answer_is_read(line: bytes, kind: str) -> None:
    assert read_status(line, "su700").kind == kind


@pytest.mark.parametrize(
    ("text", "supply"),
    [
        ("bench@localhost", Supply("bench", "localhost", 3493)),
        ("su700@192.168.1.5:4000", Supply("su700", "192.168.1.5", 4000)),
        ("su700@[::1]:4000", Supply("su700", "::1", 4000)),
    ],
)
def test_an_address_is_read(text: str, supply: Supply) -> None:
    assert PowerEntry.model_validate({"ups": text}).ups == supply


@pytest.mark.parametrize("text", ["bench", "@localhost", "bench@", "bench@host:0", "bench@host:99999", "a b@host", 5])
def test_what_is_no_address_is_refused(text: object) -> None:
    with pytest.raises(ValidationError, match="NAME@HOST"):
        PowerEntry.model_validate({"ups": text})


def asked(serve: Serve, times: int = 1) -> list[PowerState]:
    """What a client finds at a server on loopback."""

    async def main() -> list[PowerState]:
        async def guarded(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            serving.add(asyncio.current_task())
            with suppress(ConnectionError):
                await serve(reader, writer)
                writer.close()
                await writer.wait_closed()

        serving: set[asyncio.Task[None] | None] = set()
        server = await asyncio.start_server(guarded, "127.0.0.1", 0)
        client = Client(Supply("u", "127.0.0.1", server.sockets[0].getsockname()[1]))
        try:
            return [await client.ask() for _ in range(times)]
        finally:
            await client.close()
            server.close()
            await asyncio.gather(*filter(None, serving))

    return asyncio.run(main())


async def _silent(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    await reader.read()


async def _half(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    await reader.readline()
    writer.write(b'VAR u ups.status "OB')


async def _endless(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    await reader.readline()
    writer.write(b"x" * 5000)
    await reader.read()


@pytest.mark.integration
@pytest.mark.parametrize(
    ("serve", "words"),
    [(_silent, "no answer within 0.2 s"), (_half, "upsd at 127.0.0.1"), (_endless, "upsd at 127.0.0.1")],
)
def test_a_server_that_misbehaves_is_not_known(serve: Serve, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(nut, "ANSWER_S", 0.2)
    (state,) = asked(serve)
    assert (state.kind, words in state.text) == ("unknown", True), state.text


@pytest.mark.integration
def test_a_connection_that_was_closed_is_made_anew() -> None:
    async def once(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readline()
        writer.write(b'VAR u ups.status "OL"\n')
        await writer.drain()

    kinds = [state.kind for state in asked(once, 6)]
    assert kinds[0] == "line"
    assert "unknown" in kinds
    assert "line" in kinds[2:]


@pytest.mark.integration
def test_a_server_that_is_not_there_is_not_known() -> None:
    state = asyncio.run(Client(Supply("u", "127.0.0.1", 1)).ask())
    assert state.kind == "unknown"
    assert "upsd at 127.0.0.1:1" in state.text


BATTERY, LINE, UNKNOWN, LOW = (PowerState(kind, "x") for kind in ("battery", "line", "unknown", "low"))


def ends(entry: dict[str, str], *states: tuple[float, PowerState]) -> list[bool]:
    policy = Policy(PowerEntry.model_validate({"ups": "u@h", **entry}))
    return [policy.ends(state, at_s) is not None for at_s, state in states]


def test_on_battery_a_run_stops_or_goes_on_for_a_time() -> None:
    assert ends({"on_battery": "stop"}, (0, LINE), (5, BATTERY)) == [False, True]
    wait = {"after": "1 min"}
    assert ends(wait, (0, BATTERY), (59, BATTERY), (60, BATTERY)) == [False, False, True]
    assert ends(wait, (0, BATTERY), (50, LINE), (70, BATTERY), (129, BATTERY)) == [False] * 4


def test_on_battery_a_run_is_held_until_line_power_is_back_but_not_for_longer_than_allowed() -> None:
    policy = Policy(PowerEntry.model_validate({"ups": "u@h", "on_battery": "hold", "after": "1 min"}))
    held = []
    for at_s, state in ((0, LINE), (5, BATTERY), (10, UNKNOWN), (15, BATTERY), (20, LINE), (25, UNKNOWN)):
        assert policy.ends(state, at_s) is None
        held.append(policy.holds)
    assert held == [False, True, True, True, False, False]
    assert [policy.ends(BATTERY, at_s) is not None for at_s in (30, 89, 90)] == [False, False, True]


def test_a_run_that_goes_on_is_not_held() -> None:
    policy = Policy(PowerEntry.model_validate({"ups": "u@h"}))
    assert policy.ends(BATTERY, 0) is None
    assert not policy.holds


def test_who_listens_late_is_told_that_the_run_is_to_be_held() -> None:
    hold, reported = Hold(), list[bool]()
    hold.want(True)
    with hold.calling(reported.append):
        hold.want(True)
        hold.want(False)
    hold.want(True)
    assert reported == [True, False]


def test_a_low_battery_ends_a_run_whatever_was_chosen() -> None:
    assert ends({"after": "1 h"}, (0, BATTERY), (5, LOW)) == [False, True]
    assert ends({"after": "1 h"}, (0, LOW)) == [True]


def test_what_is_not_known_ends_nothing_and_is_not_line_power() -> None:
    assert ends({"after": "1 min"}, (0, UNKNOWN), (500, UNKNOWN)) == [False, False]
    assert ends({"after": "1 min"}, (0, BATTERY), (30, UNKNOWN), (60, BATTERY)) == [False, False, True]


def test_only_another_state_is_news() -> None:
    policy = Policy(PowerEntry.model_validate({"ups": "u@h"}))
    assert [policy.is_changed(state) for state in (LINE, LINE, BATTERY, UNKNOWN, UNKNOWN)] == [
        True, False, True, True, False,
    ]  # fmt: skip
