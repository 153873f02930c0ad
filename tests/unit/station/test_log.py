"""Log: one line for each event whatever names contain, without secrets; a stuck station gives no sign of life."""

import asyncio
import io
import json
import logging
import os
import socket
from datetime import UTC, datetime

import pytest

from bench.clock import Stopwatch
from bench.station.log import Changes, libraries_in, make_log
from bench.station.part import Part
from bench.station.queue.items import Item, Submission
from bench.station.runs.live import Live
from bench.station.watchdog import Watchdog, watchdog_every_s
from tests.support.in_process import inside, settings_of

HOSTILE = 'a\r\nb\x1b[31m\x00\x7f\u2028\u202e\ud800<script>alert(1)</script>"}\n{"event": "forged"'


def lines_of(stream):
    text = stream.getvalue()
    assert text.isascii()
    assert text.replace("\n", "").isprintable()
    return [json.loads(line) for line in text.splitlines()]


class Resting(Part):
    async def look(self):
        pass


def test_hostile_names_are_one_line_each():
    stream = io.StringIO()
    log = make_log(stream)
    part = Resting()
    part.problem = HOSTILE
    changes = Changes(log, {"queue": part}, Live(list))
    asyncio.run(changes.look())
    submission = Submission.model_construct(sequence=HOSTILE, bench=HOSTILE, units={})
    item = Item.model_construct(
        id="x", number=1, state="queued", submission=submission,
        run=HOSTILE, verdict=None, reason=HOSTILE, submitted_at=datetime(2026, 1, 1, tzinfo=UTC),
    )  # fmt: skip
    changes.item(item)
    log.info("request", path=HOSTILE * 1000)
    found = lines_of(stream)
    assert [each["event"] for each in found] == ["part", "item", "request"]
    assert found[0]["problem"] == HOSTILE
    assert all(each["timestamp"].endswith("Z") for each in found)
    assert len(found[2]["path"]) == 2000


def test_requests_are_logged_without_their_secrets(tmp_path):
    stream = io.StringIO()

    async def main():
        async with inside(settings_of(tmp_path), make_log(stream)) as (_, clients):
            await clients["viewer"].get(
                "/api/v1/runs/a%0d%0ab%1b%3Cscript%3E?token=s3cret", headers={"cookie": "s3cret"}
            )
            await clients["viewer"].post("/api/v1/login", json={"name": "anna", "password": "s3cret"})
            return clients["viewer"].headers["authorization"].split()[1]

    token = asyncio.run(main())
    first, second = lines_of(stream)
    assert (first["path"], first["status"], first["who"]) == ("/api/v1/runs/a\r\nb\x1b<script>", 422, "anna")
    assert second["path"] == "/api/v1/login"
    assert "s3cret" not in stream.getvalue()
    assert token not in stream.getvalue()


def test_the_traceback_of_a_library_is_on_one_line():
    stream = io.StringIO()
    hostile = HOSTILE.replace("\ud800", "")  # which pytest, who keeps messages as well, cannot pass on
    with libraries_in(make_log(stream)):
        try:
            raise ValueError(hostile)
        except ValueError:
            logging.getLogger("uvicorn.error").exception("failed\r\n%s", hostile)
    (found,) = lines_of(stream)
    assert found["library"] == "uvicorn.error"
    assert "ValueError" in found["traceback"]


@pytest.fixture
def systemd(tmp_path, monkeypatch):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(str(tmp_path / "notify"))
        receiver.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        yield receiver


def test_the_watchdog_is_fed_until_a_part_is_stuck(systemd):
    part = Resting()
    watchdog = Watchdog([part], 1.0)
    asyncio.run(watchdog.look())
    assert systemd.recv(100) == b"WATCHDOG=1"
    part.looked = Stopwatch(before_s=part.every_s + part.stuck_after_s + 1)
    asyncio.run(watchdog.look())
    with pytest.raises(BlockingIOError):
        systemd.recv(100)


@pytest.mark.parametrize(
    ("interval", "process", "every_s"),
    [("", "", None), ("60000000", "", 30.0), ("60000000", "1", None), ("0", "", None), ("x", "", None)],
)
def test_half_the_interval_of_systemd_for_this_process_only(monkeypatch, interval, process, every_s):
    monkeypatch.setenv("WATCHDOG_USEC", interval)
    monkeypatch.setenv("WATCHDOG_PID", process or str(os.getpid()))
    assert watchdog_every_s() == every_s


def test_a_station_under_systemd_has_the_watchdog_of_all_its_parts(tmp_path, monkeypatch):
    monkeypatch.setenv("WATCHDOG_USEC", "60000000")

    async def main():
        async with inside(settings_of(tmp_path, phone="json://127.0.0.1:9/x")) as (daemon, _):
            return daemon.parts

    parts = asyncio.run(main())
    watchdog = parts["watchdog"]
    assert watchdog.every_s == 30
    assert {*watchdog._parts, watchdog} == set(parts.values())
    assert "alert route phone" in parts
