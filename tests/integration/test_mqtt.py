"""A station and a real broker: topics, last will, access, an outage and commands."""

from __future__ import annotations

import json
import os
import re
import signal
import threading
from collections import Counter
from contextlib import closing
from datetime import timedelta
from uuid import uuid4

import pytest

from bench.clock import Stopwatch, wall_utc
from bench.station.mqtt.positions import Positions
from bench.station.mqtt.reference import DISCOVERY, TOPICS
from bench.store.tail import Tail
from tests.support.broker import broker, station_file, subscribed, tls_settings
from tests.support.station import serving

pytestmark = [pytest.mark.integration, pytest.mark.slow, pytest.mark.peer("mosquitto")]
ASKS = """\
schema: itb-sequence/1
title: A question
needs: {head: positioner}
steps:
  - prompt: Turn the unit.
  - move: head
    to: 30°
  - wait: 10 h
"""


def command(run, name="abort", **more):
    return {"command": name, "run": run, "nonce": uuid4().hex, "at": wall_utc().isoformat(), **more}


def journal(folder, run):
    with Tail(folder / "runs" / run) as tail:
        return tail.events()


def entries(folder, run):
    return [event.seq for event in journal(folder, run)]


def running(station):
    return station.get("station")["benches"][0]["running"]


def with_question(folder):
    (folder / "own").mkdir()
    (folder / "own/asks.yaml").write_text(ASKS)


def test_every_documented_topic_is_seen_with_tls_password_and_access_list(tmp_path):
    with_question(tmp_path)
    with broker(tmp_path / "broker", tls=True) as of, subscribed(of, topic="bench/#") as seen, \
            subscribed(of, "anna", "bench/lab3/replies/anna") as anna:  # fmt: skip
        file = station_file(
            tmp_path, of, tls=tls_settings(), home_assistant=True,
            commands={"enabled": True, "users": ["anna"]},
        )  # fmt: skip
        with serving(tmp_path, file) as station:
            item = station.post("queue", {"sequence": "asks", "bench": "demo", "speed": "20"})
            questions = seen.until(lambda: [each for each in seen.of("/questions") if each])
            assert questions[0]["questions"][0]["text"] == "Turn the unit."
            run = questions[0]["run"]
            station.post(f"runs/{run}/answer", {"answer": "done"})
            seen.until(lambda: seen.of("/questions")[-1] is None)
            seen.until(lambda: seen.of("/readings/head.angle"))
            state = seen.until(lambda: [each for each in seen.of("/demo/state") if each["done"]])[-1]
            assert state["run"] == run
            anna.publish("bench/lab3/commands/anna", command(run))
            assert station.ended(item)["outcome"] == "aborted"
            anna.until(lambda: anna.received)
            assert anna.received[0].content["done"] is True
            seen.until(lambda: seen.of("/results"))
            assert [each["kind"] for each in seen.of("/alarms")][-1] == "run_ended"
            assert [each["seq"] for each in seen.of("/events")] == entries(tmp_path, run)
            assert seen.of("/status")[-1]["status"] == "online"
        seen.until(lambda: seen.of("/status")[-1]["status"] == "offline")
    topics = {each.topic.replace("lab3", "STATION").replace("demo", "BENCH") for each in seen.received}
    topics |= {each.topic.replace("lab3", "STATION") for each in anna.received}
    topics = {re.sub("readings/.*", "readings/CHANNEL", topic).replace("anna", "USER") for topic in topics}
    log = (tmp_path / "broker/mosquitto.log").read_text()
    assert f"'{DISCOVERY.replace('STATION', 'lab3').replace('BENCH', 'demo')}'" in log
    assert "Denied" not in log
    topics |= {"bench/STATION/commands/USER"}  # which only the station may read
    assert {each.pattern for each in TOPICS} == topics


def test_the_broker_publishes_the_last_will_of_a_killed_station(tmp_path):
    with broker(tmp_path / "broker") as of, subscribed(of, topic="bench/#") as seen:
        for number in (1, 2):
            with serving(tmp_path, station_file(tmp_path, of)) as station:
                seen.until(lambda: seen.of("/status") and seen.of("/status")[-1]["status"] == "online")
                os.kill(station.process.pid, signal.SIGKILL)
                seen.until(lambda: seen.of("/status")[-1]["status"] == "offline", within_s=5)
            assert [each["bd_seq"] for each in seen.of("/status")[-2:]] == [number, number]


def test_the_access_list_denies_what_it_shall(tmp_path):
    with broker(tmp_path / "broker") as of, subscribed(of, topic="bench/#") as seen, \
            subscribed(of, "anna", "homeassistant/#") as anna:  # fmt: skip
        for topic in ("bench/lab3/status", "bench/lab3/commands/dashboard", "bench/lab3/commands/anna"):
            seen.publish(topic, {})
        assert seen.refused == ["Not authorized"] * 3
        anna.publish("bench/lab3/commands/station", {})
        assert anna.refused == ["Not authorized"]
        with serving(tmp_path, station_file(tmp_path, of, station="lab4")) as station:
            problems = station.until(lambda: station.get("station")["problems"])
            assert "refuses messages (Not authorized) to bench/lab4/" in problems[0]
            assert "access list" in problems[0]
        assert seen.received == []
        with closing(Positions(tmp_path / "station")) as positions:
            assert positions.is_new is False


def test_neither_a_broker_of_another_authority_nor_a_client_without_a_certificate_is_trusted(tmp_path):
    with broker(tmp_path / "broker", tls=True) as of, subscribed(of, topic="bench/#") as seen:
        with serving(tmp_path, station_file(tmp_path, of, tls=tls_settings("other"))) as station:
            problems = station.until(lambda: station.get("station")["problems"])
            assert "certificate verify failed" in problems[0]
        without = dict.fromkeys(("certificate", "key"), "")
        with serving(tmp_path, station_file(tmp_path, of, tls=tls_settings(**without))) as station:
            station.until(lambda: station.get("station")["problems"])
        assert seen.received == []


def test_an_outage_loses_no_event_and_delivers_none_of_them_as_new(tmp_path):
    with broker(tmp_path / "broker") as of, subscribed(of, topic="bench/#") as seen:
        file = station_file(tmp_path, of)
        with serving(tmp_path, file) as station:
            first = station.submit(speed="10")
            seen.until(lambda: len(seen.of("/events")) > 5)
            of.stop()
            seen.until(lambda: not seen.is_connected)
            live = len(seen.of("/events"))
            runs = [station.ended(first)["run"], *(station.ended(station.submit())["run"] for _ in range(2))]
            last = station.submit(speed="10")
            station.until(lambda: station.get(f"queue/{last['id']}")["run"])
        runs.append(station_run(tmp_path))  # it goes on, and ends while neither broker nor station is there
        until_ended(tmp_path / "runs" / runs[-1])
        of.start()
        with serving(tmp_path, file):
            seen.until(lambda: len(seen.of("/results")) == 4)
        events = seen.of("/events")
        expected = {run: entries(tmp_path, run) for run in runs}
        first_of_id = list({each["id"]: each for each in events}.values())
        for run in runs:
            assert [each["seq"] for each in first_of_id if each["run"] == run] == expected[run]
        on_the_way = 20  # messages that a broker or a client sends before one of them is acknowledged
        assert len(events) - len(first_of_id) <= on_the_way
        flags = [each["is_historical"] for each in events]
        late = flags.index(True)
        assert live <= late <= live + on_the_way
        assert (any(flags[:late]), all(flags[late:])) == (False, True)
        assert all(each["is_historical"] for each in seen.of("/results"))


def station_run(folder):
    return sorted(path.name for path in (folder / "runs").iterdir())[-1]


def until_ended(run):
    watch, pause = Stopwatch(), threading.Event().wait
    while json.loads((run / "manifest.json").read_text())["state"] == "running":
        assert watch.elapsed_s() < 60
        pause(0.1)


def test_retained_expired_and_repeated_commands_are_refused_and_audited(tmp_path):
    with_question(tmp_path)
    with broker(tmp_path / "broker") as of, subscribed(of, "anna", "bench/lab3/replies/anna") as anna:
        file = station_file(tmp_path, of, commands={"enabled": True, "users": ["anna"]})
        topic = "bench/lab3/commands/anna"
        anna.publish(topic, command("any", nonce="retained-1"), retain=True)
        with serving(tmp_path, file) as station:
            item = station.post("queue", {"sequence": "asks", "bench": "demo", "speed": "20"})
            run = station.until(lambda: station.get(f"queue/{item['id']}")["run"])
            station.until(lambda: [each for each in running(station) if each["questions"]])
            paused = command(run, "pause")
            for content in (
                paused, paused, command(run, at=(wall_utc() - timedelta(seconds=31)).isoformat()),
                command(run, at=(wall_utc() + timedelta(seconds=31)).isoformat()),
                command(run, "resume"), command("../../etc"), command(run, nonce="short"), ["abort"], "abort",
            ):  # fmt: skip
                anna.publish(topic, content)
            anna.publish(topic, command(run), retain=True)
            anna.until(lambda: len(anna.received) == 11)
            replies = [each.content for each in anna.received]
            assert [each["done"] for each in replies] == [False, True, *[False] * 9]
            words = [
                "retained",
                "",
                "repeated",
                "30 s",
                "30 s",
                "command:",
                "no run",
                "nonce",
                "valid",
                "valid",
                "retained",
            ]
            assert [word for word, reply in zip(words, replies, strict=True) if word not in reply["text"]] == []
            asked = [event for event in journal(tmp_path, run) if event.kind == "command"]
            assert [(event.data["command"], event.data["by"]) for event in asked] == [("pause", "anna")]
            audited = Counter(each["action"] for each in station.get("audit") if each["how"] == "mqtt")
            assert audited == {"pause": 1, "command refused": 10}
            anna.publish(topic, command(run))
            assert station.ended(item)["outcome"] == "aborted"
