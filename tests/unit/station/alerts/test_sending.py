"""Routes at work: real receivers on loopback, a dead route beside a good one, a process that dies while it sends."""

import asyncio
import os
import subprocess
import sys
import textwrap
from datetime import timedelta

import pytest
from pydantic import SecretStr

from bench.clock import wall_utc
from bench.station.alerts.kinds import Cause, Kind
from bench.station.alerts.route import NO_ANSWER, Sending, send
from bench.station.alerts.settings import Route, RouteEntry
from bench.station.alerts.table import AlertTable
from bench.station.alerts.words import Message
from bench.station.storage.database import Database
from bench.store.tried import last_tried
from tests.support.receivers import dead_server, mail_server, webhook

pytestmark = pytest.mark.lengthy


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def route_to(url, name="phone"):
    return Route(name, RouteEntry(), SecretStr(url))


def test_a_webhook_and_a_mail_have_the_three_lines(tmp_path):
    message = Message("Lab 3: 温度", "what\nwhat to do\nhttp://b/runs/r1\n")
    with webhook() as hook:
        assert asyncio.run(send(route_to(hook.url), message)) == ""
        assert (hook.received[0]["title"], hook.received[0]["message"].split("\n")) == (
            "Lab 3: 温度", ["what", "what to do", "http://b/runs/r1"],
        )  # fmt: skip
    with mail_server() as (url, mails):
        assert asyncio.run(send(route_to(url), message)) == ""
    assert "To: anna@example.org" in mails.received[0]


def test_a_refusal_is_told_without_the_address_and_a_success_is_noted_for_the_preflight(tmp_path):
    database = Database(tmp_path)
    with webhook() as hook:
        route = route_to(hook.url)
        sending = Sending(route, AlertTable(database, {"phone": route}), lambda _: Message("t", "b"))
        hook.status = 500
        problem = asyncio.run(sending.test(Message("t", "b")))
        assert "error=500" in problem
        assert "s3cret" not in problem
        assert last_tried("alert", route.key) is None
        hook.status = 200
        assert asyncio.run(sending.test(Message("t", "b"))) == ""
    assert wall_utc() - last_tried("alert", route.key) < timedelta(minutes=1)
    assert (sending.failures, sending.successes, sending.failure) == (1, 1, "")
    database.close()


def cause(key):
    return Cause(Kind.ALARM, key, key, "alarm", {"bench": "a", "text": key})


def test_a_dead_route_delays_no_other_and_its_failure_is_shown(tmp_path):
    database = Database(tmp_path)

    async def main(hook, dead):
        routes = {"dead": route_to(dead, "dead"), "phone": route_to(hook.url)}
        table = AlertTable(database, routes)
        parts = [Sending(each, table, lambda way: Message(way.alert, "b")) for each in routes.values()]
        parts[0].limit_s = 1.0
        table.add([cause("1"), cause("2")], wall_utc())
        tasks = [asyncio.create_task(part.work()) for part in parts]
        while len(hook.received) < 2 or not parts[0].problem:  # noqa: ASYNC110  a thread and another part do that
            await asyncio.sleep(0.02)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        return parts[0].problem, table

    with webhook() as hook, dead_server() as dead:
        problem, table = asyncio.run(main(hook, dead))
    assert NO_ANSWER in problem
    ways = {way.route: way for way in table.deliveries(hook.received[0]["title"])}
    assert ways["phone"].state == "sent"
    assert ways["dead"].state != "sent"
    assert any(way.again for each in table.newest(9) for way in table.deliveries(each.id) if way.route == "dead")
    database.close()


SENDER = textwrap.dedent("""
    import asyncio, sys
    from pathlib import Path
    from pydantic import SecretStr
    from bench.clock import wall_utc
    from bench.station.alerts.kinds import Cause, Kind
    from bench.station.alerts.route import Sending
    from bench.station.alerts.settings import Route, RouteEntry
    from bench.station.alerts.table import AlertTable
    from bench.station.alerts.words import Message
    from bench.station.storage.database import Database
    route = Route("phone", RouteEntry(), SecretStr(sys.argv[2]))
    table = AlertTable(Database(Path(sys.argv[1])), {"phone": route})
    if sys.argv[3] == "first":
        table.add([Cause(Kind.ALARM, "k", "r", "alarm", {})], wall_utc())
    part = Sending(route, table, lambda way: Message(f"again={way.again}", "b"))
    asyncio.run(part.look())
""")


def sender(folder, hook, which):
    return subprocess.Popen([sys.executable, "-c", SENDER, str(folder), hook.url, which])


def test_an_alert_that_was_being_sent_at_kill_9_is_sent_once_more_and_marked(tmp_path):
    """The cause is told once, to the first process: what the second one knows is what the disk has."""
    with webhook() as hook:
        first = sender(tmp_path, hook, "first")
        hook.on_receipt = lambda: os.kill(first.pid, 9)  # the answer comes too late
        assert first.wait() == -9
        hook.on_receipt = lambda: None
        for _ in range(2):  # the third one has nothing to send
            assert sender(tmp_path, hook, "again").wait() == 0
    assert hook.titles == ["again=False", "again=True"]
