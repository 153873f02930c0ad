"""The client of a station: where it looks for one, time limits, and errors in the words of the station."""

import json
import os
import subprocess
import sys

import pytest

from bench.client import Station
from bench.client.address import TOKEN, WHERE, announced, announcement, from_environment
from bench.client.http import NoReply, NoStation
from bench.client.sse import ServerEvent, server_events
from bench.clock import Stopwatch
from bench.errors import BenchError, InputError, StaleError
from tests.support.bad_station import answering, json_answer

ITEM = json.dumps({"id": "1", "number": 1, "state": "queued"})


def station_folder(folder, pid=None):
    content = json.loads(announcement("http://0.0.0.0:8421/", folder / "runs", None))
    (folder / WHERE).write_text(json.dumps(content | ({"pid": pid} if pid is not None else {})))
    (folder / TOKEN).write_text("secret\n")
    return folder


def test_a_station_is_found_by_what_it_has_written_and_at_this_computer(tmp_path):
    found = announced(station_folder(tmp_path))
    assert (found.url, found.token, found.runs) == ("http://127.0.0.1:8421/", "secret", tmp_path / "runs")


def test_no_token_is_sent_to_the_port_of_a_station_that_was_killed(tmp_path):
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
    assert announced(station_folder(tmp_path, process.pid)) is None
    with pytest.raises(NoStation, match="'bench serve' starts one"):
        Station.found(tmp_path)


def test_a_folder_without_a_station_has_none_and_a_broken_file_is_named(tmp_path):
    assert announced(tmp_path) is None
    (tmp_path / WHERE).write_text("{")
    with pytest.raises(InputError, match=r"station\.json: cannot be used"):
        announced(tmp_path)


def test_the_environment_names_a_station_and_needs_a_token():
    assert from_environment({}) is None
    assert from_environment({"BENCH_STATION": "https://a/", "BENCH_TOKEN": "t"}).token == "t"
    with pytest.raises(InputError, match="bench tokens new"):
        from_environment({"BENCH_STATION": "https://a/"})


@pytest.mark.parametrize(
    "url", ["ftp://a/", "http:///", "127.0.0.1:8421", "http://user@a/", "http://a:x/", "http://[a/"]
)
def test_an_address_that_is_none_is_refused(url):
    with pytest.raises(InputError, match="is not the address of a station"):
        Station(url, "t")


def test_a_token_that_would_be_several_headers_is_refused():
    with pytest.raises(InputError, match="characters that no token has"):
        Station("http://a/", "t\r\nhost: b")


@pytest.mark.parametrize(
    ("status", "error"),
    [("422 x", InputError), ("403 x", InputError), ("409 x", StaleError), ("503 x", BenchError), ("302 x", BenchError)],
)
def test_errors_are_in_the_words_of_the_station(status, error):
    answer = json_answer('{"detail": "in its words"}', status)
    with answering(answer) as (station, _), pytest.raises(error, match="in its words"):
        station.me()


def test_what_is_no_station_is_named():
    with answering(json_answer("<html>")) as (station, _), pytest.raises(BenchError, match="not that of a station"):
        station.me()


def test_a_name_stays_within_its_part_of_a_path():
    with answering(json_answer("{}")) as (station, received):
        station.item("../users?x#y")
    assert received[0].startswith(b"GET /api/v1/queue/..%2Fusers%3Fx%23y HTTP/1.1\r\n")
    with pytest.raises(InputError):
        station.item("..")


@pytest.mark.parametrize("answer", [b"", b"HTTP/1.1 200 OK\r\ncontent-le", json_answer("{}", more=10)])
def test_a_station_that_hangs_is_left_within_the_limit(answer):
    with answering(answer, then_hangs=True) as (station, _):
        watch = Stopwatch()
        with pytest.raises(NoReply):
            station.abort("run")
        assert 0.4 < watch.elapsed_s() < 1.5


def test_an_answer_that_trickles_is_left_within_the_limit():
    """Each byte restarts the limit of a socket, and must not restart that of a request."""
    script = (
        "import socket, time; s = socket.create_server(('127.0.0.1', 0)); print(s.getsockname()[1], flush=True); "
        "c, _ = s.accept()\nwhile True: c.sendall(b'H'); time.sleep(0.1)"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as server:
        station = Station(f"http://127.0.0.1:{int(server.stdout.readline())}/", "t", limit_s=0.5)
        watch = Stopwatch()
        with pytest.raises(NoReply):
            station.abort("run")
        assert watch.elapsed_s() < 1.5
        server.kill()


def test_a_submission_without_an_answer_is_sent_again_with_its_key():
    cut = json_answer(ITEM, more=5)
    with answering(b"", cut, json_answer(ITEM)) as (station, received):
        station.limit_s = 30.0
        assert station.submit("smoke", "demo")["number"] == 1
    keys = [line for text in received for line in text.lower().split(b"\r\n") if line.startswith(b"idempotency-key")]
    assert len(keys) == 3
    assert len(set(keys)) == 1


def test_a_change_without_an_answer_is_not_sent_again():
    with answering(b"", json_answer(ITEM)) as (station, received), pytest.raises(NoReply):
        station.clone("1")
    assert len(received) == 1


def stream(*entries, end=False):
    text = (
        "".join(f'id: {n}\nevent: step\ndata: {{"seq": {n}}}\n\n' for n in entries) + "event: end\ndata: {}\n\n" * end
    )
    return f"HTTP/1.1 200 OK\r\ncontent-type: text/event-stream\r\n\r\n{text}".encode()


def test_a_stream_that_was_cut_is_continued_behind_its_last_entry():
    cut = stream(1, 2) + b'id: 3\nevent: step\ndata: {"seq"'
    with answering(cut, b"", stream(3, 4, end=True)) as (station, received):
        station.limit_s = 30.0
        assert [entry["seq"] for entry in station.events("run")] == [1, 2, 3, 4]
    last = [line for text in received for line in text.lower().split(b"\r\n") if line.startswith(b"last-event-id")]
    assert last == [b"last-event-id: 0", b"last-event-id: 2", b"last-event-id: 2"]


def test_a_stream_of_a_station_that_does_not_come_back_ends_with_an_error():
    with answering(stream(1)) as (station, _):
        events = station.events("run")
        assert next(events)["seq"] == 1
    with pytest.raises(NoStation):
        next(events)


def test_events_have_lines_comments_and_data_of_several_lines():
    lines = b": alive\n\nid: 7\nevent: a\ndata: x\ndata: y\n\nevent: no data\n\ndata: cut\n".splitlines(keepends=True)
    assert list(server_events(lines)) == [ServerEvent("7", "a", "x\ny")]


def test_the_client_needs_nothing_but_the_core():
    script = (
        "import sys, bench.client; "
        "print([m for m in ('httpx', 'fastapi', 'uvicorn', 'argon2', 'pydantic', 'bench.station') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=dict(os.environ))
    assert done.stdout == "[]\n"
