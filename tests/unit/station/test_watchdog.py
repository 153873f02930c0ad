"""The sign of life of a station comes from the event loop of its parts."""

import asyncio
import contextlib
import socket

import pytest

from bench.runner.notify import VARIABLE
from bench.station.watchdog import PERIOD, Watchdog


@pytest.fixture
def manager(tmp_path, monkeypatch):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as found:
        found.bind(str(tmp_path / "notify"))
        found.setblocking(False)
        monkeypatch.setenv(VARIABLE, str(tmp_path / "notify"))
        yield found


def signs(manager):
    found = 0
    with contextlib.suppress(BlockingIOError):
        while manager.recv(100) == b"WATCHDOG=1":
            found += 1
    return found


async def at_work(watchdog):
    working = asyncio.create_task(watchdog.work())
    await asyncio.sleep(0.3)
    working.cancel()


def test_a_sign_comes_at_least_twice_in_the_time_that_is_allowed_for_one(manager, monkeypatch):
    monkeypatch.setenv(PERIOD, "100000")
    asyncio.run(at_work(Watchdog()))
    assert 4 <= signs(manager) <= 8


@pytest.mark.parametrize("period", ["", "soon", "-1"])
def test_without_a_period_there_is_a_sign_now_and_then(manager, monkeypatch, period):
    monkeypatch.setenv(PERIOD, period)
    assert Watchdog().every_s == 10.0
    asyncio.run(at_work(Watchdog()))
    assert signs(manager) == 1
