"""Work ahead: what a page needs is there before somebody looks, and is made again when a file or a run has changed."""

import asyncio
import socket

import pytest
from jinja2 import Environment

from bench.station.prepare import sequences
from bench.station.runs.catalogue import Catalogue
from bench.station.units import histories
from bench.station.units.histories import Histories
from bench.web import ahead
from bench.web.ahead import Ahead
from bench.web.listening import Listening, listener_of
from bench.web.pages import render
from tests.support.station_pages import HTML, asked
from tests.support.stored_results import finding, instant, stored


def refuse(*_args, **_named):
    raise AssertionError("a page has made this itself")


def test_the_first_look_finds_everything_made(tmp_path, monkeypatch):
    stored(tmp_path / "runs", instant(2020), [finding(0.0)])
    monkeypatch.setattr(ahead, "AFTER_S", 0.0)
    ahead.COMPILED.kept.clear()
    render.environment.cache_clear()

    async def work():
        async with asked(tmp_path, tmp_path / "runs") as station:
            await Ahead(station.services.daemon).look()
            with monkeypatch.context() as made:
                made.setattr(Environment, "_generate", refuse)
                made.setattr(sequences, "load_sequence", refuse)
                made.setattr(histories, "history", refuse)
                for path in ("/start", "/unit?serial=QF-1", "/", "/queue", "/runs"):
                    assert (await station.client.get(path, headers=HTML)).status_code == 200, path

    asyncio.run(work())


def test_a_changed_sequence_is_read_again(tmp_path):
    own = tmp_path / "own"
    own.mkdir()
    (own / "mine.yaml").write_text("schema: itb-sequence/1\ntitle: Mine\nneeds: {}\nsteps: [{wait: 1 s}]\n")

    async def work():
        async with asked(tmp_path, tmp_path / "runs") as station:
            found = station.services.daemon.sequences
            found._settings = found._settings._replace(sequences=own)
            found.all()
            assert found.changed() == {}
            assert found.named("mine").title == "Mine"
            (own / "mine.yaml").write_text("schema: itb-sequence/1\ntitle: Longer\nneeds: {}\nsteps: [{wait: 1 s}]\n")
            assert list(found.changed()) == [own / "mine.yaml"]
            assert found.named("mine").title == "Longer"

    asyncio.run(work())


def test_a_history_is_made_again_when_a_run_is_new_or_has_changed(tmp_path):
    found = Histories(Catalogue(tmp_path))
    first = stored(tmp_path, instant(2020), [finding(0.0)])
    assert [each.value for each in found.of("QF-1").series[0].points] == pytest.approx([0.0])
    assert not found.lacks("QF-1", found.runs_of("QF-1"))
    stored(tmp_path, instant(2021), [finding(1.0)])
    assert found.lacks("QF-1", found.runs_of("QF-1"))
    assert [each.value for each in found.of("QF-1").series[0].points] == pytest.approx([0.0, 1.0])
    manifest = first / "manifest.json"
    manifest.write_text(manifest.read_text().replace('"ended": "2020', '"ended": "2022'))
    assert found.lacks("QF-1", found.runs_of("QF-1"))


def test_an_accepted_connection_sends_at_once():
    with listener_of(Listening(port=0)) as listener, socket.create_connection(listener.getsockname()):
        accepted, _ = listener.accept()
        with accepted:
            assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) == 1
