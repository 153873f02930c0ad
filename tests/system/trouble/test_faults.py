"""Instruments that break in the middle of a run: the run ends in words, nothing hangs, everything is made safe."""

import pytest

from bench.store.reader import RunReader
from tests.support.runs import copy_bench, read_json, run_short


def broken(tmp_path, faults, **options):
    bench = copy_bench(tmp_path / "config", faults=faults)
    return run_short(tmp_path / "runs", bench=bench, sequence="smoke", settings=("soak=60 min",), **options)


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ("{device: chamber, kind: silent, at: 30 min}", "chamber: no answer within 3 s"),
        ("{device: chamber, kind: cut, at: 30 min}", "chamber: the connection to sim+tcp://127.0.0.1:1502 was closed"),
        ("{device: supply, kind: silent, at: 30 min}", "supply: no answer within 2 s"),
        ("{device: supply, kind: cut, at: 30 min}", "supply: the connection was closed"),
        ("{device: head, kind: silent, at: 30 min}", "head: no answer within 2 s"),
        ("{device: counter, kind: silent, at: 30 min}", "counter: counter frames have stopped"),
        ("{device: counter, kind: frozen, at: 30 min}", "counter: the counter is frozen"),
        ("{device: head, kind: stuck, at: 30 min}", "step steps/temperature=20/position=0/move: head: "),
    ],
)
def test_a_broken_instrument_ends_the_run_with_what_where_and_what_to_do(tmp_path, fault, expected):
    result = broken(tmp_path, f"[{fault}]")
    assert result.outcome.how == "error"
    assert expected in result.problems[0]
    assert result.results.verdict == "ERROR"
    assert result.bench_s < 30 * 60 + 900 or "stuck" in fault, "it was noticed in bounded time"
    manifest = read_json(result, "manifest.json")
    assert (manifest["state"], manifest["verdict"]) == ("error", "ERROR")
    assert manifest["problems"][0] == result.problems[0]


@pytest.mark.parametrize("device", ["chamber", "counter", "head", "source"])
def test_when_another_instrument_breaks_the_units_are_switched_off_by_the_teardown(tmp_path, device):
    result = broken(tmp_path, f"[{{device: {device}, kind: silent, at: 30 min}}]")
    with RunReader(result.path) as reader:
        ended = {event.step: event.data for event in reader.events("step_ended")}
        made_safe = [event.data["unsafe"] for event in reader.events("made_safe")]
    off = ended["teardown/set"]
    assert (off["output"], off["current_a"]) == (False, 0.0), "as the supply itself says"
    assert set(made_safe[0]) == ({device} - {"counter"}), "a silent instrument is named, and no other"


def test_what_was_acquired_before_the_fault_is_kept_and_reduced(tmp_path):
    bench = copy_bench(tmp_path / "config", faults="[{device: chamber, kind: silent, at: 3 h}]")
    result = run_short(tmp_path / "runs", bench=bench, settings=("warm_up=0 s", "soak=30 min", "gate=10 s"))
    assert result.results.verdict == "ERROR"
    bias = [finding for finding in result.results.units[0].findings if finding.quantity == "K0"]
    assert [finding.at["temperature_set_c"] for finding in bias] == [20.0, 30.0, 40.0, 50.0]
    with RunReader(result.path) as reader:
        assert sum(1 for event in reader.events("step_ended") if event.step.endswith("/acquire")) >= 4 * 8


@pytest.mark.parametrize(
    ("window", "limit"), [("{min: 30 mA, max: 50 mA}", "the units draw 60 mA, expected 30 to 50 mA"),
                          ("{min: 70 mA, max: 110 mA}", "the units draw 60 mA, expected 70 to 110 mA")]
)  # fmt: skip
def test_a_supply_current_outside_its_window_is_an_error(tmp_path, window, limit):
    bench = copy_bench(tmp_path / "config", ("supply_current: {min: 30 mA, max: 110 mA}", f"supply_current: {window}"))
    result = run_short(tmp_path / "runs", bench=bench, sequence="smoke")
    assert result.outcome.how == "error"
    assert limit in result.problems[0]
    with RunReader(result.path) as reader:
        ended = {event.step: event.data for event in reader.events("step_ended")}
    assert ended["teardown/set"]["output"] is False


def test_a_unit_that_leaves_its_temperature_limits_is_an_error(tmp_path):
    bench = copy_bench(tmp_path / "config", ("limits: {min: -55 °C, max: 105 °C}", "limits: {min: -55 °C, max: 23 °C}"))
    result = run_short(tmp_path / "runs", bench=bench, sequence="smoke", settings=("soak=30 min",))
    assert result.outcome.how == "error"
    assert "unit_temperature: 23." in result.problems[0]
    assert "outside -55 to 23 °C" in result.problems[0]


def test_an_instrument_that_cannot_be_opened_ends_the_run_before_anything_moves(tmp_path):
    edit = ("connection: sim+tcp://127.0.0.1:5025", "connection: tcp://127.0.0.1:5")
    bench = copy_bench(tmp_path / "config", edit)
    result = run_short(tmp_path / "runs", bench=bench, sequence="smoke", units=("QF-1",))
    assert result.outcome.how == "error"
    assert "supply: no connection to tcp://127.0.0.1:5" in result.problems[0]
    with RunReader(result.path) as reader:
        assert [event.kind for event in reader.events()] == [
            "run_begins", "problem", "not_reached", "made_safe", "run_ended",
        ]  # fmt: skip
    assert result.results.verdict == "ERROR"


def test_an_answer_that_is_lost_once_is_asked_for_again_and_the_run_goes_on(tmp_path):
    devices = {"chamber": 0, "head": 8, "supply": 4, "source": 2}  # when each is polled, in s after every 10 s
    lost = (
        f"{{device: {device}, kind: silent, at: {600 * number + polled_s} s, for: 1.8 s}}"
        for number, (device, polled_s) in enumerate(devices.items(), start=1)
    )
    result = broken(tmp_path, f"[{', '.join(lost)}]")
    assert (result.outcome.how, result.problems) == ("completed", [])
    with RunReader(result.path) as reader:
        notes = [(event.data["device"], event.data["text"]) for event in reader.events("device_note")]
    assert [device for device, _ in notes] == list(devices)
    assert all("asked again: " in text for _, text in notes)
