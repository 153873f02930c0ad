"""Outputs minus their expectation, and the newest samples as they were acquired."""

import numpy as np
import pytest

from bench.config.bench import load_bench
from bench.config.fixture import Mount
from bench.station.runs import deviation
from bench.station.runs.deviation import Expectation, Stimulus
from bench.station.runs.scope import newest_samples, period_s
from bench.station.runs.series import joined, thinned, with_latched
from bench.store.reader import Event
from bench.store.tail import Bucket, Tail
from tests.support.runs import ROOT, run_short

HEAD = load_bench(ROOT / "config" / "simulated.yaml").bench
MOUNTS = {"upright": Mount(), "inverted": Mount(angle="180°"), "clocked": Mount(clock="90°")}
TURNED = Expectation(
    HEAD.model_copy(update={"fixture": HEAD.fixture.model_copy(update={"mounts": MOUNTS})}), "a", "pulse/s", 1000.0
)
CHANNEL = load_bench(ROOT / "config" / "channel.yaml").bench
CHANNEL_IMU = load_bench(ROOT / "config" / "channel_imu.yaml").bench
FED = Expectation(CHANNEL, "a", "pulse/s", 11_300.0, 1e7)
STEPS = """\
schema: itb-sequence/1
title: Short
needs: {supply: power_supply, output: output%s}
steps:
  - {set: supply, voltage: %s V, current_limit: %s A, output: on}
%steardown:
%s  - {set: supply, output: off}
"""
ATTITUDES = [("down", "north"), ("west", "up"), ("east", "north"), ("up", "west")]


class Journal:
    """The steps of a run, for a tail."""

    def __init__(self, *events):
        self._events = [Event(n, at_s, kind, "s", data) for n, (at_s, kind, data) in enumerate(events)]

    def steps_with(self, texts):
        found = [each for each in self._events if any(text.strip('"') in str(each.data) for text in texts)]
        return [each for each in found if each.kind != "run_resumed"]

    def of_kinds(self, kinds, limit):
        return [each for each in self._events if each.kind in kinds][:limit]


def away(at_s, *events, expected=TURNED):
    acts = deviation.course(Journal(*events), expected.bench)
    found = deviation.deviation(acts, expected, [Bucket(at_s, 990.0, 1010.0, 1000.0)], 1.0)
    return [round(each.mean, 6) for each in found]


def recorded(folder, bench, volts, amperes, steps, needs="", off=""):
    """The series of a run of some steps: a function of the names of channels."""
    sequence = folder / "short.yaml"
    text = STEPS % (needs, volts, amperes, "".join(f"  - {each}\n" for each in steps), off)
    sequence.write_text(text, "utf-8")
    ended = run_short(folder / "runs", bench=ROOT / "config" / bench, sequence=str(sequence))
    assert ended.path is not None
    return lambda *names: {name: each.buckets for name, each in thinned(ended.path, names, 0.0, 1.0).items()}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return run_short(tmp_path_factory.mktemp("deviation"), sequence="smoke").path


@pytest.mark.parametrize(
    ("angle_deg", "mount", "pps"),
    [(90.0, None, 1000.0), (30.0, None, 500.0), (90.0, "inverted", -1000.0), (90.0, "clocked", 0.0), (0.0, None, 0.0)],
)
def test_the_expectation_follows_angle_and_mount(angle_deg, mount, pps):
    assert TURNED.at(Stimulus({"head": angle_deg}, mount=mount)) == pytest.approx(pps, abs=1e-9)


def test_there_is_none_before_the_head_was_moved_and_while_it_moves():
    moved = (1.0, "step_begins", {"device": "head"}), (5.0, "step_ended", {"device": "head", "angle_deg": 90.0})
    assert away(0.0) == []
    assert away(10.0, *moved) == [0.0]
    assert away(2.0, *moved) == []
    assert away(4.5, *moved) == []  # it arrives within the interval
    assert away(10.0, *moved, (8.0, "step_begins", {"device": "head", "target_deg": 1.0})) == []
    assert away(10.0, *moved, (8.0, "step_ended", {"mount": "inverted"})) == [2000.0]


def test_there_is_none_after_an_interruption_until_the_head_is_moved_again():
    moved = (1.0, "step_begins", {"device": "head"}), (5.0, "step_ended", {"device": "head", "angle_deg": 90.0})
    assert away(10.0, *moved, (8.0, "run_resumed", {})) == []
    assert away(10.0, *moved, (7.0, "run_resumed", {}), *((at_s + 7.0 - 5.0, *rest) for at_s, *rest in moved)) == [0.0]


def test_while_a_source_feeds_the_converter_its_current_counts():
    plugged = (1.0, "step_ended", {"input": "source"})
    on = (5.0, "step_ended", {"role": "source", "current_a": 1e-4, "output": True, "voltage_v": None})
    assert away(3.0, expected=FED) == [pytest.approx(1000.0 - 11_300.0)]  # up, as it is mounted first
    assert away(3.0, plugged, expected=FED) == [1000.0]
    assert away(10.0, plugged, on, expected=FED) == [0.0]
    assert away(10.0, plugged, on, (8.0, "step_ended", {"role": "source", "output": False}), expected=FED) == [1000.0]


def test_a_simulated_unit_is_near_its_expectation(run):
    found = thinned(run, ["counter.x", "counter.x.deviation", "counter.y.deviation"], 0.0, 5.0)
    assert found.keys() == {"counter.x", "counter.x.deviation"}  # no unit is stated for y
    rates, deviations = (found[name].buckets for name in ("counter.x", "counter.x.deviation"))
    assert max(abs(each.mean) for each in rates) > 10_000
    assert len(deviations) > len(rates) / 2
    assert all(abs(each.mean) < 200 for each in deviations)


def test_the_voltage_of_a_unit_is_near_its_expectation(tmp_path):
    steps = [
        step
        for angle in (90, 30)
        for step in (f"{{move: head, to: {angle}°}}", "{acquire: output, for: 20 s, label: still}")
    ]
    series = recorded(tmp_path, "volts.yaml", 15, 0.12, steps, needs=", head: positioner")
    found = series("dvm.voltage", "dvm.voltage.deviation")
    assert len(found["dvm.voltage.deviation"]) > 15
    assert max(abs(each.mean) for each in found["dvm.voltage"]) == pytest.approx(1.13, rel=0.01)
    assert max(abs(each.mean) for each in found["dvm.voltage.deviation"]) < 0.01


@pytest.mark.parametrize(("bench", "unit"), [("imu.yaml", "counter"), ("imu_telemetry.yaml", "telemetry")])
def test_an_inertial_unit_is_near_its_expectation_on_each_axis(tmp_path, bench, unit):
    steps = [
        step
        for x, z in ATTITUDES
        for step in (f"{{orient: {{x: {x}, z: {z}}}}}", "{acquire: output, for: 5 s, label: still}")
    ]
    series = recorded(tmp_path, bench, 28, 1, steps)
    sensors = [f"{unit}.{name}" for name in ("ax", "ay", "az")]
    found = series(*sensors, *(f"{name}.deviation" for name in sensors), f"{unit}.gx", f"{unit}.gx.deviation")
    assert f"{unit}.gx" in found
    assert f"{unit}.gx.deviation" not in found
    for name in sensors:
        outputs, deviations = found[name], found[f"{name}.deviation"]
        assert len(deviations) >= 4 * 3
        assert max(abs(each.mean) for each in deviations) < 0.02 * max(abs(each.mean) for each in outputs)


def test_of_an_inertial_unit_the_current_counts_for_the_channel_that_the_source_feeds():
    acts = Stimulus(input="source", input_channel="acc_y", sources_a={"source": 1e-4})
    of_channels = {each.channel: each.at(acts) for _, each in deviation._expectations(CHANNEL_IMU) if each.channel}
    assert of_channels == pytest.approx({"acc_x": 0.0, "acc_y": 1000.0, "acc_z": 0.0})
    plugged = (1.0, "step_ended", {"input": "source", "input_channel": "acc_z"})
    back = (2.0, "step_ended", {"input": "accelerometer", "mount": "z_up"})
    assert [each.input_channel for _, each in deviation.course(Journal(plugged, back), CHANNEL_IMU)] == [
        "",
        "acc_z",
        "",
    ]


def test_a_converter_is_near_what_its_source_lets_expect(tmp_path):
    steps = [
        "{prompt: Plug the source in., expect: {input: source}}",
        *(
            step
            for level in (0.1, -3)
            for step in (
                f"{{set: source, acceleration: {level} g, place: a, compliance: 10 V, output: on}}",
                "{acquire: output, for: 5 s, label: fed}",
            )
        ),
    ]
    series = recorded(
        tmp_path, "channel.yaml", 15, 0.12, steps, ", source: current_source", "  - {set: source, output: off}\n"
    )
    found = series("counter.x", "counter.x.deviation")
    assert max(abs(each.mean) for each in found["counter.x"]) == pytest.approx(3 * 11_300, rel=0.01)
    assert len(found["counter.x.deviation"]) >= 6
    assert all(abs(each.mean) < 100 for each in found["counter.x.deviation"])


def test_wider_intervals_have_the_extremes_of_those_in_them():
    fine = [Bucket(0.0, -1.0, 1.0, 0.0), Bucket(4.0, -5.0, 3.0, 2.0), Bucket(10.0, 0.0, 1.0, 0.5)]
    assert joined(fine, 10.0) == [Bucket(0.0, -5.0, 3.0, 1.0), Bucket(10.0, 0.0, 1.0, 0.5)]


def test_latched_angles_have_the_ends_of_an_oscillation_that_readings_miss():
    read = [Bucket(0.0, 3.0, 4.0, 3.5), Bucket(2.0, 3.0, 3.0, 3.0), Bucket(6.0, 359.0, 361.0, 360.0)]
    latched = [
        Bucket(0.0, -10.0, 10.0, 0.1), Bucket(2.0, 0.0, 300.0, 150.0),  # the second one while it turns
        Bucket(4.0, -10.0, 10.0, 0.0), Bucket(6.0, -2.0, 2.0, 0.0),
    ]  # fmt: skip
    assert with_latched(read, latched) == [
        Bucket(0.0, -10.0, 10.0, 0.1), Bucket(2.0, 3.0, 3.0, 3.0), Bucket(4.0, -10.0, 10.0, 0.0),
        Bucket(6.0, 358.0, 362.0, 360.0),
    ]  # fmt: skip
    assert with_latched(read, []) == read


def test_the_scope_has_every_latch_of_the_newest_acquisition(run):
    found = newest_samples(run, lambda _: 3.0)
    samples = found.channels["counter.x"]
    assert (samples.unit, found.step.rpartition("/")[2]) == ("pulse/s", "acquire")
    assert np.diff(samples.at_s) == pytest.approx(0.1, abs=0.001)
    assert len(samples.values) == pytest.approx(30, abs=1)
    assert samples.at_s[-1] == pytest.approx(found.until_s, abs=0.2)
    with Tail(run) as tail:
        assert found.until_s == tail.blocks(0.0, 1)[0].last_s


def test_the_period_is_that_of_the_oscillation_around_a_step():
    steps = [
        {"id": "steps/move", "facts": {"verb": "move"}},
        {"id": "steps/oscillate", "facts": {"verb": "oscillate", "frequency_hz": 4.0}},
        {"id": "steps/sweep", "facts": {"verb": "oscillate", "sweep": {"from_hz": 2.0, "to_hz": 100.0}}},
    ]
    assert period_s(steps, "steps/oscillate/acquire") == 0.25
    assert period_s(steps, "steps/sweep/acquire") == 0.5
    assert period_s(steps, "steps/move") is None
    assert period_s([], "steps/oscillate/acquire") is None
