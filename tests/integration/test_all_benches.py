"""One page for twenty benches on a real broker: a question, a death, a broker that restarts, and hostile messages."""

from __future__ import annotations

import json
import re
import threading
from contextlib import ExitStack
from datetime import timedelta
from pathlib import Path

import pytest

from bench.clock import Stopwatch, wall_utc
from bench.overview.fold import MOST_STATIONS
from tests.integration.test_mqtt import with_question
from tests.support.broker import broker, station_file, subscribed, tls_settings
from tests.support.overview_served import showing
from tests.support.publishing import publishing, station_of
from tests.support.station import serving

pytestmark = [pytest.mark.integration, pytest.mark.slow, pytest.mark.peer("mosquitto")]
CARD = re.compile(r'<li class="bench-card kind-(\w+)">\s*<h3><a href="[^"]*">([^<]*)</a>')


def cards(page):
    """Kind of each bench by its title, in the order of the page."""
    return {title: kind for kind, title in CARD.findall(page)}


def test_twenty_benches_a_question_a_death_and_a_restart_of_the_broker(tmp_path):
    with broker(tmp_path / "broker", is_open=True) as of, ExitStack() as stack:
        others = [station_of(tmp_path, of.port, number, ends_min=20 + number) for number in range(1, 18)]
        idle = station_of(tmp_path, of.port, 18, "idle")
        stack.enter_context(publishing([*others, idle]))
        asking = stack.enter_context(publishing([station_of(tmp_path, of.port, 19, "asks", text="Turn <b>it</b>.")]))
        dying = stack.enter_context(publishing([station_of(tmp_path, of.port, 20)]))
        with showing(tmp_path, f"mqtt://127.0.0.1:{of.port}") as board:
            page = board.until(lambda page: len(cards(page)) == 20 and "−39." in page, within_s=60)
            kinds = cards(page)
            assert next(iter(kinds)) == "Bench 19"
            assert list(kinds)[-1] == "Bench 18"
            assert [kinds[each] for each in ("Bench 19", "Bench 20", "Bench 18")] == ["asks", "running", "idle"]
            assert "Turn &lt;b&gt;it&lt;/b&gt;." in page
            assert 'href="http://lab19.example.org:8421/benches/a"' in page
            assert "ends about" in page
            dying.kill()
            page = board.until(lambda page: cards(page)["Bench 20"] == "lost", within_s=5)
            assert "last heard less than a minute ago" in page
            asking.end()
            board.until(lambda page: "the station was ended at" in page, within_s=10)
            threading.Event().wait(2.5)  # a last will sooner before the end of a broker is one of its own making
            of.stop()
            expected = ["idle", "lost", "lost", *["running"] * 17]
            page = board.until(lambda page: "No connection to the broker since" in page, within_s=10)
            assert sorted(cards(page).values()) == expected
            of.start()
            page = board.until(lambda page: "No connection to the broker" not in page, within_s=30)
            assert sorted(cards(page).values()) == expected
            board.until(lambda page: " old</span>" not in page, within_s=90)  # within their minute of patience
            assert sorted(cards(board.page()).values()) == expected
        with subscribed(of, topic="bench/#") as seen:
            log = {each.topic.split("/")[1] for each in seen.received}
        assert log <= {f"lab{number}" for number in range(1, 21)}, "the page publishes nothing"


def test_a_hostile_client_costs_neither_the_page_nor_its_memory(tmp_path):
    with broker(tmp_path / "broker", is_open=True) as of, subscribed(of, "hostile", "none") as hostile, \
            publishing([station_of(tmp_path, of.port, 1)]), \
            showing(tmp_path, f"mqtt://127.0.0.1:{of.port}") as board:  # fmt: skip
        board.until(lambda page: "Bench 01" in page, within_s=60)
        then = (wall_utc() - timedelta(days=100)).isoformat()
        long = "\U0001f600" * 5000
        for number in range(10_000):
            topic = f"bench/hostile{number % 1000}/{number}/state"
            message = json.dumps({"title": f"<img src=x>{long if number % 10 == 0 else ''}", "at": then})
            hostile._client.publish(topic, message, 0, True)
        for payload in (b"\xff", b"[" * 100_000, b"x" * 1_000_000):
            hostile._client.publish("bench/lab1/a/state", payload, 1).wait_for_publish(30)
        hostile.publish("bench/dead/status", {"status": "online", "bd_seq": 1, "at": then}, retain=True)
        page = board.until(lambda page: "The broker has more stations or benches" in page, within_s=60)
        watch = Stopwatch()
        page = board.page()
        assert watch.elapsed_s() < 5
        assert "<img" not in page
        assert page.count('class="bench-card') <= 3 * MOST_STATIONS
        page = board.until(lambda page: "Some of its messages cannot be read" in page)
        assert next(iter(cards(page).items())) == ("Bench 01", "running")
        assert board.memory_mb() < 400


def test_a_real_station_with_tls_password_and_access_list(tmp_path):
    with_question(tmp_path)
    secret = tmp_path / "dashboard.password"
    secret.write_text("dashboard\n")
    secret.chmod(0o600)
    with broker(tmp_path / "broker", tls=True) as of:
        certs = tmp_path / "broker/certs"
        names = (("--ca", "ca.pem"), ("--client-certificate", "client.pem"), ("--client-key", "client.key"))
        files = [word for name, file in names for word in (name, str(certs / file))]
        station = station_file(tmp_path, of, tls=tls_settings())
        url = f"mqtts://dashboard@localhost:{of.port}"
        with serving(tmp_path, station) as served, \
                showing(tmp_path, url, *files, "--password-file", str(secret)) as board:  # fmt: skip
            board.until(lambda page: "Laboratory 3" in page, within_s=60)
            served.post("queue", {"sequence": "asks", "bench": "demo", "units": {"a": "QF-0001"}, "speed": "20"})
            page = board.until(lambda page: "Turn the unit." in page, within_s=60)
            assert "QF-0001" in page
            assert f'href="{served.url}benches/demo"' in page, "this is its computer"
            run = served.get("station")["benches"][0]["running"][0]["run"]
            served.post(f"runs/{run}/answer", {"answer": "done"})
            page = board.until(lambda page: cards(page).popitem()[1] == "running", within_s=30)
            page = board.until(lambda page: "Waiting" in page, within_s=30)
            assert "等待" in board.page(**{"accept-language": "zh"})
            commands = [path.read_bytes() for path in Path("/proc").glob("[0-9]*/cmdline")]
            assert any(b"--password-file" in each for each in commands)
            assert not any(b"dashboard\n" in each or b":dashboard@" in each for each in commands)
            served.post(f"runs/{run}/abort")
            board.until(lambda page: "aborted" in page or "ABORTED" in page, within_s=30)
        log = (tmp_path / "broker/mosquitto.log").read_text()
        assert not re.search(r"Received PUBLISH from bench-overview", log)
        assert "as bench-overview-" in log


def test_the_password_of_the_environment_and_one_that_is_wrong(tmp_path):
    with broker(tmp_path / "broker") as of:
        url = f"mqtt://dashboard@127.0.0.1:{of.port}"
        with showing(tmp_path, url, env={"BENCH_BROKER_PASSWORD": "dashboard"}) as board:
            board.until(lambda page: "No connection to the broker" not in page)
        with showing(tmp_path, url, env={"BENCH_BROKER_PASSWORD": "wrong"}) as board:
            page = board.until(lambda page: "Not authorized" in page or "Bad user name" in page)
            assert "No connection to the broker since" in page
