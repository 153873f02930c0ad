"""Which run a command means, and whether the station of this user knows it."""

import json
import socket

import pytest

from bench.cli.through import MAKING_SAFE, meant, tell
from bench.client.address import TOKEN, WHERE, announcement, default_folder
from bench.clock import Stopwatch
from bench.errors import BenchError, InputError
from bench.store.runs import LOCK

RUN = "20260101T000000Z_smoke_A"


@pytest.fixture
def runs(tmp_path, monkeypatch):
    """Two folders with a run of the same name: one by hand, one of the station."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    for name in ("hand", "station"):
        (tmp_path / name / RUN).mkdir(parents=True)
        (tmp_path / name / RUN / LOCK).touch()
    return tmp_path


def announce(runs, url="http://127.0.0.1:9/", text=None):
    default_folder().mkdir()
    (default_folder() / TOKEN).write_text("secret")
    (default_folder() / WHERE).write_bytes(announcement(url, runs / "station", None) if text is None else text)


def test_only_a_run_in_the_folder_of_the_station_is_one_of_it(runs):
    assert meant("last", runs / "station") == (RUN, runs / "station" / RUN, None)
    announce(runs)
    assert meant("last", runs / "hand")[1:] == (runs / "hand" / RUN, None)
    name, path, station = meant("last", runs / "nowhere")
    assert (name, path, station.runs_folder) == (RUN, runs / "station" / RUN, runs / "station")
    with pytest.raises(InputError, match="no run 'x'"):
        meant("x", runs / "hand")


@pytest.mark.parametrize("text", [b"{", b"[]", b'{"pid": 1}', b"\xff", None])
def test_a_run_is_reached_whatever_is_wrong_with_the_station(runs, text, monkeypatch):
    announce(runs, text=text) if text is not None else monkeypatch.setenv("BENCH_STATION", "http://a/")
    assert meant(RUN, runs / "hand") == (RUN, runs / "hand" / RUN, None)


def test_a_command_that_could_not_be_sent_goes_directly(runs):
    announce(runs)  # nothing listens at port 9
    for command in ("skip", "abort"):
        with pytest.raises(InputError, match="this run is not running"):
            tell(RUN, runs / "station", command)


def test_only_what_is_harmless_twice_goes_directly_without_an_answer(runs, monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        announce(runs, f"http://127.0.0.1:{silent.getsockname()[1]}/")
        for command in MAKING_SAFE:
            watch = Stopwatch()
            with pytest.raises(InputError, match="this run is not running"):
                tell(RUN, runs / "station", command)
            assert 0.9 < watch.elapsed_s() < 3.0
        monkeypatch.setattr("bench.cli.through.COMMAND_LIMIT_S", 0.2)
        with pytest.raises(BenchError, match="has not answered"):
            tell(RUN, runs / "station", "skip")


def test_the_announcement_names_this_process(tmp_path):
    found = json.loads(announcement("https://[::]:1/", tmp_path, tmp_path / "c.pem"))
    assert (found["url"], found["certificate"]) == ("https://[::1]:1/", str(tmp_path / "c.pem"))
