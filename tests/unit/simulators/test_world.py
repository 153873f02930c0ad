import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.app.drawn import world_settings
from bench.app.laboratory import make_laboratory, unit_files
from bench.config.bench import load_bench
from bench.errors import InputError
from drivers.can.frame_block import FrameBlock
from drivers.can.sorted_block import SortedBlock
from drivers.dialects.can_counter.wire import decode_counts, latches, temperatures
from drivers.errors import LinkLost
from simulators.faults.instrument_faults import FaultPlan
from simulators.physics.motion import AxisErrors
from simulators.units.accelerometer import UnitTruth
from simulators.units.imu import ImuState
from simulators.units.unit_temperatures import ThermometerErrors
from tests.support.laboratory import ARCSEC_DEG, ROOT, Laboratory, counter_form, place, unit
from tests.support.planar import planar

FORM = counter_form()
HALF_G = {"K0": {"at_reference": "0.5 g"}}  # 5000 pulse/s at any attitude that leaves the input axis level


# Time


def test_the_world_runs_on_true_time_and_the_host_on_its_own_clock() -> None:
    lab = Laboratory(host_clock=20e-6)
    assert lab.wait(1e6) == lab.world.now() == pytest.approx(1e6 + 20, abs=1e-9)
    assert lab.world.true_time(5e5) == pytest.approx(5e5 + 10, abs=1e-9)
    assert lab.world.host_time(np.array([1e6 + 20])) == pytest.approx([1e6], abs=1e-9)


def test_a_world_begins_when_it_is_made() -> None:
    lab = Laboratory()
    lab.host_s = 500.0
    later = Laboratory()
    later.host_s = 0.0
    assert (lab.world.now(), later.world.now()) == (500.0, 0.0)
    assert lab.world.true_time(500.0) == 500.0


# Attitude


@pytest.mark.parametrize(
    ("settings", "mount_deg", "above_horizontal_deg"),
    [
        ({}, 0.0, 30.0),
        ({"fixture": planar(-1, 90)}, 0.0, 60.0),
        ({"fixture": planar(-1, 0)}, 5.0, -25.0),
        ({"level_deg": 0.25}, 5.0, 35.25),
        ({"axes": {"head": AxisErrors(zero_deg=0.5)}}, 0.0, 30.5),
        ({"axes": {"head": AxisErrors(zero_deg=0.5)}, "fixture": planar(-1, 0)}, 0.0, -30.5),
    ],
)
def test_the_axes_stand_as_fixture_head_and_level_say(
    settings: Any, mount_deg: float, above_horizontal_deg: float
) -> None:
    lab = Laboratory(place(mount_angle_deg=mount_deg), **settings)
    lab.world.move(30, 20)
    lab.wait(10)
    along, pendulous, output = lab.world.units["a"].force_g(np.array([10.0]))
    angle = math.radians(above_horizontal_deg)
    assert (along[0], pendulous[0], output[0]) == pytest.approx((math.sin(angle), math.cos(angle), 0), abs=1e-12)


def test_a_stopped_head_stands() -> None:
    lab = Laboratory()
    lab.world.move(90, 20)
    lab.wait(2.5)
    lab.world.stop()
    lab.wait(100)
    assert lab.world.axis.encoder_deg(lab.world.now()) == 45.0


def test_a_head_that_was_put_somewhere_stands_there_as_it_came_there() -> None:
    lab = Laboratory(axes={"head": AxisErrors(zero_deg=0.01, backlash_deg=0.002)})
    lab.world.move(90, 20)
    lab.wait(2)
    for from_above, off_deg in ((False, 0.01), (True, 0.012)):
        lab.world.place(181.0, from_above=from_above)
        assert not lab.world.axis.moving(lab.world.now())
        assert lab.world.axis.encoder_deg(lab.world.now()) == 181.0
        assert lab.world.axis.still_deg(lab.world.now()) == pytest.approx(181 + off_deg)
    lab.wait(100)
    assert lab.world.axis.encoder_deg(lab.world.now()) == 181.0


def test_who_comes_to_an_angle_anew_by_hand_scatters_anew() -> None:
    lab = Laboratory(axes={"head": AxisErrors(repeatability_deg=0.001)})
    stood = []
    for _ in range(3):
        lab.world.place(90.0, from_above=False)
        stood.append(lab.world.axis.still_deg(lab.world.now()))
    assert len(set(stood)) == 3


# Power


def test_a_supply_feeds_the_units_on_it() -> None:
    lab = Laboratory(place("x"), place("y", supply="other"), place("z"))
    lab.wait(5)
    lab.world.power("supply", True)
    lab.wait(5)
    lab.world.power("supply", True)  # switching on what is on changes nothing
    assert [unit.powered_at_s for unit in lab.world.units.values()] == [5.0, None, 5.0]
    assert (lab.world.load_a("supply"), lab.world.load_a("other"), lab.world.load_a("none")) == (0.12, 0.06, 0)
    lab.world.power("supply", False)
    lab.world.power("other", True)
    assert [unit.powered_at_s for unit in lab.world.units.values()] == [None, 10.0, None]


def test_power_warms_the_units_on_it() -> None:
    warm = unit(thermal={"self_heating": "5 °C"})
    lab = Laboratory(place("x", unit=warm), place("y", unit=warm, supply="other"))
    lab.world.power("supply", True)
    lab.wait(1e5)
    assert [lab.world.thermal.sensor_c(n) for n in (0, 1)] == pytest.approx([25, 20])


# The counter's frames


def counts(block: FrameBlock, channel: str = "x") -> tuple[np.ndarray, np.ndarray]:
    found = decode_counts(FORM, channel, block)
    return found.positive, found.negative


def test_latches_come_at_device_time_and_arrive_at_host_time() -> None:
    lab = Laboratory(host_clock=20e-6, device_clock=-50e-6)
    counter = lab.counter()
    lab.wait(1000)
    found = decode_counts(FORM, "x", counter.take())
    assert set(np.diff(found.tick) % 2**32) == {100_000}
    assert set(np.diff(found.sequence)) == {1}
    true_s = 0.1 / (1 - 50e-6) * np.arange(1, len(found.tick) + 1)
    assert found.host_s == pytest.approx(true_s / (1 + 20e-6), rel=1e-12)
    assert len(found.tick) == math.floor(1000 * (1 + 20e-6) * (1 - 50e-6) / 0.1)


def test_the_rate_on_the_device_clock_has_the_error_of_that_clock_alone() -> None:
    lab = Laboratory(place(unit=unit(accelerometer=HALF_G)), host_clock=1e-3, device_clock=1e-3)
    lab.world.power("supply", True)
    counter = lab.counter()
    lab.wait(1000)
    found = decode_counts(FORM, "x", counter.take())
    span_s = (len(found.tick) - 1) * 0.1
    assert (found.positive[-1] - found.positive[0]) / span_s == pytest.approx(5000 / (1 + 1e-3), abs=1 / span_s)


def test_the_tick_goes_round_every_71_minutes_and_the_sequence_at_65536() -> None:
    lab = Laboratory(device_clock=1e-5)
    counter = lab.counter()
    ticks, numbers = [], []
    for _ in range(80):
        lab.wait(100)
        found = decode_counts(FORM, "x", block := counter.take())
        ticks.append(found.tick)
        numbers.append(latches(FORM, block)[0])
    tick, number = np.concatenate(ticks), np.concatenate(numbers)
    assert np.count_nonzero(np.diff(tick) < 0) in (1, 2)
    assert set(np.diff(tick) % 2**32) == {100_000}
    assert np.count_nonzero(np.diff(number) < 0) in (1, 2)
    assert set(np.diff(number) % 2**16) == {1}


def test_counts_go_round_at_the_width_of_their_field() -> None:
    lab = Laboratory(place())
    lab.world.power("supply", True)
    lab.world.move(90, 20)
    counter = lab.counter()
    lab.wait(3600)  # 36 million pulses; the field goes round at 16.8 million
    positive, _ = counts(counter.take())
    assert positive.max() < 2**24
    assert np.count_nonzero(np.diff(positive) < 0) in (2, 3)
    steps = np.diff(positive) % 2**24
    assert set(steps[100:]) == {1000}


def test_frames_are_in_order_of_time() -> None:
    lab = Laboratory(place())
    counter = lab.counter()
    blocks = []
    for _ in range(10):
        lab.wait(3.3)
        blocks.append(counter.take())
    block = FrameBlock.joined(blocks)
    assert np.all(np.diff(block.at_s) >= 0)
    assert block.ids[:9].tolist() == [0x100, 0x101, 0x102, 0x103] * 2 + [0x100]
    assert block.ids.tolist().count(0x110) == 33


def test_channels_without_a_unit_and_units_without_power_stand() -> None:
    lab = Laboratory(place("x", unit=unit(accelerometer=HALF_G)), place("y", unit=unit(accelerometer=HALF_G)))
    counter = lab.counter()
    lab.wait(10)
    block = counter.take()
    for channel in "xyz":
        assert [set(np.diff(line)) for line in counts(block, channel)] == [{0}, {0}]
    lab.world.power("supply", True)
    lab.wait(10)
    block = counter.take()
    assert [set(np.diff(counts(block, channel)[0])) for channel in "xyz"] == [{500}, {500}, {0}]


def test_three_units_count_on_three_channels() -> None:
    lab = Laboratory(
        place("x"), place("y", mount_angle_deg=90), place("z", mount_angle_deg=180),
    )  # fmt: skip
    lab.world.power("supply", True)
    lab.world.move(30, 20)
    lab.wait(10)
    counter = lab.counter()
    lab.wait(100)
    block = counter.take()
    net = [np.diff(positive - negative).mean() * 10 for positive, negative in (counts(block, name) for name in "xyz")]
    assert net == pytest.approx([5000, 10_000 * math.cos(math.radians(30)), -5000], abs=0.02)


def test_frames_come_sorted_by_message_in_the_order_of_a_bus() -> None:
    lab = Laboratory(place())
    counter = lab.counter()
    lab.wait(2.05)
    block = counter.take()
    assert isinstance(block, SortedBlock)
    latch, warm = [0x100, 0x101, 0x102, 0x103], [0x110]
    assert block.ids.tolist() == [*latch * 10, *warm, *latch * 10, *warm]
    of_latches = np.repeat(np.arange(1, 21) / 10, 4)
    assert block.at_s == pytest.approx(np.insert(of_latches, [40, 80], [1.0, 2.0]), abs=1e-9)


def test_a_stimulus_that_changes_between_latches_counts_to_its_moment() -> None:
    lab = Laboratory(place(unit=unit(accelerometer=HALF_G)))
    counter = lab.counter()
    lab.wait(10.03)
    lab.world.power("supply", True)
    lab.wait(0.05)
    lab.world.power("supply", False)
    lab.wait(0.005)
    lab.world.power("supply", True)
    lab.wait(0.116)
    lab.world.move(30, 20)  # two changes at one instant
    lab.world.stop()
    lab.wait(0.1)
    positive, _ = counts(counter.take())
    # 10.0 to 10.1: 0.05 s and then 0.015 s with power; 10.1 to 10.2 and 10.2 to 10.3 all of it
    assert np.diff(positive)[98:].tolist() == [0, 325, 500, 500]


def test_how_often_frames_are_taken_changes_what_they_say_by_a_pulse_at_most() -> None:
    """A noisy unit in a ramp, at 0.1 s and 10 s. The slow wander alone is drawn by the block; it is left out."""
    noisy = {"K0": {"at_reference": "0.5 g", "linear": "10 µg/°C"}, "noise": {"density": "2 µg/Hz^0.5"}}

    def run(every_s: float) -> FrameBlock:
        lab = Laboratory(place(unit=unit(accelerometer=noisy)), thermometer_noise_c=0.005)
        lab.world.power("supply", True)
        lab.world.ramp(50, 3 / 60)
        counter = lab.counter()
        blocks = []
        for tick in range(1, round(300 / every_s) + 1):
            lab.host_s = tick * every_s + 0.01
            blocks.append(counter.take())
        return FrameBlock.joined(blocks)

    often, seldom = run(0.1), run(10.0)
    assert often.ids.tolist() == seldom.ids.tolist()
    assert often.at_s == pytest.approx(seldom.at_s, abs=1e-9)
    first, second = (decode_counts(FORM, "x", block) for block in (often, seldom))
    assert first.tick.tolist() == second.tick.tolist()
    assert first.sequence.tolist() == second.sequence.tolist()
    assert np.abs(first.positive - second.positive).max() <= 1
    warm, warm_too = (temperatures(FORM, block)["Temperatures.Unit"][1] for block in (often, seldom))
    assert np.abs(warm - warm_too).max() <= 0.03


# Temperatures


def readings_c(lab: Laboratory, duration_s: float) -> np.ndarray:
    counter = lab.counter()
    lab.wait(duration_s)
    return temperatures(FORM, counter.take())["Temperatures.Unit"][1]


def test_temperatures_come_once_a_second_in_hundredths() -> None:
    lab = Laboratory(place(thermometer=ThermometerErrors(0.1234)), thermometer_noise_c=0.05)
    counter = lab.counter()
    lab.wait(1000.05)
    found = temperatures(FORM, counter.take())
    at_s, values = found["Temperatures.Unit"]
    assert np.diff(at_s) == pytest.approx(np.ones(999))
    assert values * 100 == pytest.approx(np.rint(values * 100), abs=1e-9)
    assert values.mean() == pytest.approx(20.1234, abs=0.006)
    assert values.std() == pytest.approx(0.05, rel=0.1)
    assert set(found["Temperatures.Converter"][1]) == {25.0}


def test_a_counter_slower_than_a_second_sends_a_temperature_with_each_latch() -> None:
    lab = Laboratory(place())
    counter = lab.counter(period_s=2.0)
    lab.wait(100)
    assert len(temperatures(FORM, counter.take())["Temperatures.Unit"][1]) == 50


def test_a_thermometer_has_an_offset_a_gain_and_a_lag() -> None:
    lab = Laboratory(place(thermometer=ThermometerErrors(0.3, 0.002)))
    lab.world.ramp(-40, math.inf)
    lab.wait(1e5)
    assert readings_c(lab, 5)[-1] == pytest.approx(-40 * 1.002 + 0.3, abs=0.006)
    lab.world.ramp(1000, 1 / 60)
    lab.wait(7200)
    counter = lab.counter()
    lab.wait(1.05)
    indicated = temperatures(FORM, counter.take())["Temperatures.Unit"][1][-1]
    behind = (indicated - 0.3) / 1.002 - lab.world.thermal.sensor_c(0)
    assert behind == pytest.approx(-20 / 60, abs=0.01)


# Faults


def test_a_counter_that_falls_silent_has_sent_what_it_sent_before() -> None:
    lab = Laboratory()
    counter = lab.counter(faults=FaultPlan({"silent": 10}, lambda: lab.host_s))
    lab.wait(5)
    assert len(counter.take()) == 5 * 40 + 5
    lab.wait(10)
    assert len(counter.take()) == 5 * 40, "the latch at 10 s, and the temperature then, are not sent any more"
    lab.wait(10)
    assert len(counter.take()) == 0


def test_a_frozen_counter_repeats_its_last_latch() -> None:
    lab = Laboratory(place(unit=unit(accelerometer=HALF_G)))
    lab.world.power("supply", True)
    counter = lab.counter()
    lab.wait(10.05)
    before = counter.take()
    counter.faults.begin("frozen")
    lab.wait(10)
    after = counter.take()
    last = {frame_id: before.data[before.ids == frame_id][-1].tolist() for frame_id in (0x100, 0x101, 0x102, 0x103)}
    for frame_id, data in last.items():
        assert after.data[after.ids == frame_id].tolist() == [data] * 100
    assert len(temperatures(FORM, after)["Temperatures.Unit"][1]) == 10, "its thermometer lives"


def test_a_cut_connection_is_an_error_that_names_the_counter() -> None:
    lab = Laboratory()
    counter = lab.counter()
    lab.wait(1)
    counter.faults.begin("cut")
    with pytest.raises(LinkLost, match="counter: the connection was cut"):
        counter.take()


def test_a_counter_that_restarts_begins_anew_and_says_so() -> None:
    lab = Laboratory(place(unit=unit(accelerometer=HALF_G)))
    lab.world.power("supply", True)
    counter = lab.counter()
    lab.wait(10.05)
    before = counter.take()
    counter.faults.begin("restart")
    lab.wait(10)
    after = decode_counts(FORM, "x", block := counter.take())
    assert after.tick.tolist() == list(range(100_000, 10_100_000, 100_000))
    assert np.abs(after.positive - np.arange(500, 50_500, 500)).max() <= 1
    assert set(after.negative) == {0}
    assert decode_counts(FORM, "x", FrameBlock.joined([before, block])).restarts == 1
    lab.wait(10)
    assert decode_counts(FORM, "x", FrameBlock.joined([block, counter.take()])).restarts == 0, "once"


# From a bench file


BENCH = load_bench(ROOT / "config" / "simulated.yaml").bench
UNITS = unit_files(BENCH, None)


def test_the_errors_that_certificates_bound_are_drawn_with_their_standard_uncertainties() -> None:
    drawn = [world_settings(BENCH, UNITS, seed) for seed in range(1500)]

    def sd(pick: Any) -> float:
        values = np.array([pick(settings) for settings in drawn])
        assert abs(values.mean()) < 4 * values.std() / math.sqrt(len(values))
        return float(values.std())

    wide = {"rel": 0.08}
    assert sd(lambda s: s.gravity_mps2 - 9.79541) == pytest.approx(0.0002, **wide)
    assert sd(lambda s: s.host_clock) == pytest.approx(20e-6, **wide)
    assert sd(lambda s: s.device_clock) == pytest.approx(0.5e-6, **wide)
    assert sd(lambda s: s.level_deg) == pytest.approx(2 * ARCSEC_DEG, **wide)
    assert sd(lambda s: s.axes["head"].zero_deg) == pytest.approx(5 * ARCSEC_DEG, **wide)
    for order in range(4):
        assert sd(lambda s, n=order: s.axes["head"].cosines[n]) == pytest.approx(1 * ARCSEC_DEG, **wide)
        assert sd(lambda s, n=order: s.axes["head"].sines[n]) == pytest.approx(1 * ARCSEC_DEG, **wide)
    assert sd(lambda s: s.places["a"].thermometer.offset_c) == pytest.approx(0.3, **wide)
    assert sd(lambda s: s.places["a"].thermometer.gain) == pytest.approx(1e-3, **wide)
    heads = [s.axes["head"] for s in drawn]
    errors = np.array([
        [s.gravity_mps2, s.host_clock, s.device_clock, s.level_deg, head.zero_deg, *head.cosines, *head.sines]
        for s, head in zip(drawn, heads, strict=True)
    ])  # fmt: skip
    assert np.abs(np.triu(np.corrcoef(errors.T), 1)).max() < 0.12, "each from a stream of its own"
    assert {s.axes["head"].backlash_deg for s in drawn} == {ARCSEC_DEG}
    assert {s.axes["head"].repeatability_deg for s in drawn} == {0.1 * ARCSEC_DEG}


def test_one_seed_is_one_laboratory() -> None:
    assert world_settings(BENCH, UNITS, 7) == world_settings(BENCH, UNITS, 7)
    assert world_settings(BENCH, UNITS, 7) != world_settings(BENCH, UNITS, 8)


def test_the_laboratory_holds_every_device_of_the_bench() -> None:
    lab = make_laboratory(BENCH, UNITS, 1, lambda: 0.0)
    assert set(lab.instruments) == {"chamber", "head", "supply", "source"}
    assert set(lab.nodes) == {"counter"}
    assert isinstance(lab.world.units["a"].truth, UnitTruth)


def test_temperatures_of_frames_left_for_a_minute_are_those_of_frames_taken_every_other_second() -> None:
    bench = load_bench(ROOT / "config/imu.yaml").bench

    def sensors_c(every_s: int) -> list[float]:
        clock_s = [0.0]
        lab = make_laboratory(bench, unit_files(bench, None), 1, lambda: clock_s[0])
        node, imu = lab.nodes["counter"], lab.world.imus["a"]
        assert node.block_s == 10.0
        lab.leave_frames(60.0)
        assert node.block_s == 60.0
        lab.world.ramp(50.0, 3 / 60)
        for clock_s[0] in range(every_s, 600 + 1, every_s):
            node.take()
        known = ImuState.of(imu.history.rows)
        return np.concatenate([np.interp(range(600), known.true_s, course_c) for course_c in known.sensors_c])

    assert sensors_c(60) == pytest.approx(sensors_c(2), abs=0.001)


def test_every_place_needs_a_simulated_unit(tmp_path: Path) -> None:
    bare = BENCH.model_copy(update={"simulation": BENCH.simulation.model_copy(update={"units": {}})})
    with pytest.raises(InputError, match="no simulated unit for place 'a'"):
        unit_files(bare, None)
    override = ROOT / "config" / "uut" / "quartz_flexure.yaml"
    assert unit_files(bare, override) == UNITS


@pytest.mark.parametrize(("name", "role"), [("simulated", "counter"), ("telemetry", "telemetry")])
def test_time_goes_on_while_a_stimulus_changes_as_it_does_in_real_time(name: str, role: str) -> None:
    bench = load_bench(ROOT / f"config/{name}.yaml").bench
    clock_s = itertools.count(0.0, 0.7e-3)  # whoever looks at it again finds it later
    lab = make_laboratory(bench, unit_files(bench, None), 1, lambda: next(clock_s))
    lab.world.power("supply", True)
    blocks = []
    for turn in range(1000):
        lab.world.move(float(turn % 2), 5.0)
        if turn % 100 == 99:
            blocks.append(lab.nodes[role].take())
    assert (np.diff(np.concatenate([block.at_s for block in blocks])) >= 0).all()
