"""Journals reach the broker whole and in order, whatever it loses; alarms and results with them."""

import asyncio
import json
import shutil
from contextlib import ExitStack, closing

import pytest

from bench.station.mqtt import connection, publisher
from bench.station.mqtt.messages import LARGEST_DATA
from bench.station.mqtt.outbox import Outbox, alarm
from bench.station.mqtt.positions import Position, Positions
from bench.station.mqtt.settings import MqttSettings
from bench.station.mqtt.start import Start
from bench.station.mqtt.topics import Topics
from bench.store.reader import Event
from bench.store.tail import Tail
from tests.support.mini_broker import mini_broker


@pytest.fixture
def runs(tmp_path, shared_runs):
    """Folder of a run that ended before, and another that ended later."""
    source = shared_runs.smoke().path
    folder = tmp_path / "runs"
    shutil.copytree(source, folder / f"2020_{source.name}")
    return folder


def later(runs):
    (old,) = runs.iterdir()
    return shutil.copytree(old, runs / f"2030{old.name[4:]}")


def seqs(run):
    with Tail(run) as tail:
        return [event.seq for event in tail.events()]


def start(tmp_path, port):
    settings = MqttSettings(host="127.0.0.1", port=port, station="lab3")
    return Start.of_line(Start(settings, tmp_path / "station", tmp_path / "runs", "Lab", "1", {}).line())


async def published(tmp_path, of, run):
    """Publish until nothing is left of a run."""
    made = publisher.Publisher(start(tmp_path, of.port))
    working = asyncio.create_task(made.work())
    try:
        async with asyncio.timeout(20):
            while not made._positions.of(run).mark:
                assert not working.done(), working.result()
                await asyncio.sleep(0.01)
    finally:
        working.cancel()
        await asyncio.gather(working, return_exceptions=True)


def test_a_broker_that_drops_connections_gets_every_event_once_or_again(tmp_path, runs, monkeypatch, capsys):
    monkeypatch.setattr(connection, "FIRST_WAIT_S", 0.01)
    monkeypatch.setattr(publisher, "LOOK_EVERY_S", 0.01)
    with closing(Positions(tmp_path / "station")) as positions:
        positions.begin({})
    run = later(runs)
    expected = seqs(run)

    async def main():
        async with mini_broker(1, 5, 14, 2, 25) as of:
            await published(tmp_path, of, run.name)
            return of

    of = asyncio.run(main())
    events = list({each["id"]: each for each in of.of("/events") if each["run"] == run.name}.values())
    assert [each["seq"] for each in events] == expected
    assert all(each["is_historical"] for each in events)
    assert [each["run"] for each in of.of("/results")].count(run.name) >= 1
    with closing(Positions(tmp_path / "station")) as positions:
        assert positions.of(run.name).seq == expected[-1]
    assert of.connections > 4
    (text,) = {line for line in capsys.readouterr().out.splitlines() if "no event is lost" in line}
    assert "127.0.0.1" in json.loads(text)["text"]


@pytest.fixture
def outbox(tmp_path, runs):
    """Makes the positions of a station, and its outbox."""
    with ExitStack() as opened:

        def make(benches=None):
            positions = opened.enter_context(closing(Positions(tmp_path / "station")))
            return positions, Outbox(runs, benches or {}, positions, Topics("lab3"))

        yield make


def test_what_ended_before_the_first_connection_is_not_published(tmp_path, runs, outbox):
    positions, box = outbox()
    box.connected()
    assert list(box.batches()) == []
    new = later(runs)
    (batch,) = box.batches()
    assert batch.run == new.name
    assert [message.is_historical for _, message in batch.messages] == [False] * 20
    positions.close()
    _, again = outbox()
    again.connected()
    (batch,) = again.batches()
    assert [message.is_historical for _, message in batch.messages] == [True] * 20


def test_the_results_come_last_with_uncertainty_and_limits(tmp_path, runs, shared_runs, outbox):
    new = later(runs)
    bench = json.loads((new / "manifest.json").read_text())["request"]["bench"]
    positions, box = outbox({bench: "left"})
    positions.begin({next(each.name for each in runs.iterdir() if each != new): Position(9, "")})
    positions.move(new.name, Position(seqs(new)[-2], ""))
    box.connected()
    batch = next(each for each in box.batches() if each.run == new.name)
    (topic, last), (last_topic, results) = batch.messages
    assert (topic, last.kind) == ("bench/lab3/left/events", "run_ended")
    assert last_topic == "bench/lab3/left/results"
    assert (results.outcome, results.verdict) == ("completed", "PASS")
    bias = next(each for each in results.findings if each.quantity == "K0")
    assert (bias.limits.min, bias.limits.max, bias.unit) == (-0.005, 0.005, "g")
    assert bias.expanded > 0
    positions.move(batch.run, batch.position)
    assert new.name not in [each.run for each in box.batches()]
    (new / "manifest.json").write_text((new / "manifest.json").read_text() + " ")  # as after `bench reduce`
    assert new.name in [each.run for each in box.batches()]


def test_a_record_that_cannot_be_read_holds_up_nothing(tmp_path, runs, outbox):
    new = later(runs)
    (new / "run.db").write_bytes(b"no database")
    (runs / "2031_not_a_run").mkdir()
    positions, box = outbox()
    positions.begin({})
    box.connected()
    for batch in box.batches():
        positions.move(batch.run, batch.position)
    assert new.name not in [each.run for each in box.batches()]


@pytest.mark.parametrize(
    ("kind", "data", "text"),
    [
        ("held", {"by": "hot"}, "held by hot"),
        ("held", {"by": "operator"}, ""),
        ("problem", {"text": "silent"}, "silent"),
        ("made_safe", {"unsafe": {}}, ""),
        ("made_safe", {"unsafe": {"chamber": "silent"}}, "not safe: {'chamber': 'silent'}"),
        ("run_ended", {"how": "completed"}, ""),
        ("run_ended", {"how": "aborted"}, "ended: aborted"),
        ("step_ended", {}, ""),
    ],
)
def test_an_alarm_is_what_needs_a_person(kind, data, text):
    assert alarm(Event(1, 0.0, kind, "", data)) == text


def test_data_that_a_broker_would_refuse_stay_in_the_record(tmp_path):
    from bench.station.mqtt.outbox import _event

    long, odd = {"text": "x" * LARGEST_DATA}, {"text": "\ud800 \x00 °"}
    event = _event("run", None, Event(1, 0.0, "note", "", long), is_historical=False)
    assert event.data == {"omitted_bytes": LARGEST_DATA + 12}
    payload = _event("run", None, Event(1, 0.0, "note", "", odd), is_historical=False).payload()
    assert json.loads(payload.encode())["data"] == odd
    assert _event("run", None, Event(1, 0.0, "note", "", {"x": float("nan")}), is_historical=False).data == {
        "unreadable": True
    }


def test_the_number_of_a_connection_is_durable(tmp_path):
    numbers = []
    for _ in range(3):
        positions = Positions(tmp_path)
        numbers += [positions.next_connection() for _ in range(100)]
        positions.close()
    assert numbers == [number % 256 for number in range(1, 301)]


def test_results_that_are_too_many_for_a_broker_are_counted(tmp_path, runs, outbox):
    new = later(runs)
    found = json.loads((new / "results.json").read_text())
    first = found["findings"][0]
    found["findings"] = [first] * 1000
    (new / "results.json").write_text(json.dumps(found))
    positions, box = outbox()
    positions.begin({})
    positions.move(new.name, Position(seqs(new)[-1], ""))
    (new / "seal.json").unlink()  # the run has changed; without a seal this is not noticed
    manifest = json.loads((new / "manifest.json").read_text())
    (new / "manifest.json").write_text(json.dumps({**manifest, "sealed": False}))
    (_, results), *_ = next(each.messages for each in box.batches() if each.run == new.name)
    assert 50 < len(results.findings) < 1000
    assert len(results.findings) + results.findings_omitted == 1000
    assert len(results.payload()) < 2 * LARGEST_DATA


@pytest.mark.integration
@pytest.mark.slow
def test_a_publisher_ends_also_where_its_farewell_fails(tmp_path):
    async def main():
        async with mini_broker(2) as of:  # it is lost with the second message
            working = asyncio.create_task(publisher.Publisher(start(tmp_path, of.port)).work())
            async with asyncio.timeout(20):
                await of.heard.wait()
                working.cancel()
                await asyncio.wait([working])
            return working.cancelled()

    assert asyncio.run(main())
