"""Which readings of a channel are believed, and what is a fault of its sensor; nothing else gets anywhere."""

from __future__ import annotations

import asyncio
import json
import math
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bench.config.bench import load_bench
from bench.config.channels import stale_after_s
from bench.config.interlocks import ReadingInterlock
from bench.config.models import BenchFile
from bench.engine.channel import Channel, Rule, rule_of
from bench.engine.interlocks import Interlocks
from bench.engine.journal import Journal
from bench.engine.monitor import Monitor
from bench.errors import StoreError
from bench.loop import AS_FAST_AS_POSSIBLE, run
from bench.quality import Fresh, Invalid, Valid, Window
from bench.rig import Rig
from bench.store.reader import RunReader
from bench.store.writer import RunWriter
from drivers.dialects.aerotech_ensemble.wire import read_angle
from drivers.dialects.keysight_3458a.wire import read_number
from drivers.dialects.newport_xps.wire import read_numbers
from drivers.kinds.chamber.words import float32_value
from drivers.protocols.scpi import number
from drivers.values import Reading
from tests.support.runs import copy_bench
from tests.unit.engine.test_interlocks import Scripted

BENCH = load_bench(Path(__file__).parents[3] / "config/simulated.yaml").bench
UNIT, AIR, SET_POINT = "counter.Temperatures.Unit", "chamber.process_value", "chamber.set_point"
FLOAT64 = st.integers(0, 2**64 - 1).map(lambda bits: struct.unpack("<d", struct.pack("<Q", bits))[0])
NAN_PAYLOAD = struct.unpack("<d", struct.pack("<Q", 0x7FF0_0000_DEAD_BEEF))[0]


def age(at_s: float) -> float:
    return 2.0 - at_s


def channel(source: str = UNIT, bench: BenchFile = BENCH, unit: str = "°C") -> Channel:
    return Channel("it", unit, rule_of(source, unit, bench))


def accepted(by: Channel, values: Sequence[float], every_s: float = 1.0) -> list[float]:
    readings = [Reading(every_s * number, value) for number, value in enumerate(values)]
    return [reading.value for reading in by.take(readings, math.inf)[0]]


def with_keys(folder: Path, keys: str) -> BenchFile:
    return load_bench(copy_bench(folder, ("stale_after: 5 s", f"stale_after: 5 s\n    {keys}"))).bench


# No number, and beyond anything


@given(FLOAT64)
@example(NAN_PAYLOAD)
@example(math.inf)
@example(-0.0)
@example(5e-324)
def test_of_all_patterns_of_64_bits_only_possible_numbers_are_believed(value: float) -> None:
    for source, unit in ((UNIT, "°C"), ("supply.voltage", "V")):
        by = Channel("it", unit, rule_of(source, unit, BENCH))
        valid, invalid = by.take([Reading(0.0, 20.0), Reading(1.0, 20.01), Reading(2.0, value)], 2.0)
        assert np.isfinite([reading.value for reading in valid]).all()
        assert (len(valid) == 3) == (math.isfinite(value) and (unit == "V" or 14 < value < 26.01))
        assert len(valid) + len(invalid) == 3
        assert isinstance(by.latest(age), Fresh if len(valid) == 3 else Invalid)
        assert isinstance(by.window(10.0, 0.0, age), Window if len(valid) == 3 else Invalid)


@given(st.integers(0, 2**32 - 1), st.sampled_from(["low_first", "high_first"]))
@example(0x7F800001, "low_first")
@example(0xFFC12345, "high_first")
def test_of_all_patterns_of_32_bits_in_either_order_of_words_a_number_or_an_error_comes(bits: int, order) -> None:
    high, low = bits >> 16, bits & 0xFFFF
    words = (low, high) if order == "low_first" else (high, low)
    expected = struct.unpack(">f", bits.to_bytes(4, "big"))[0]
    if math.isfinite(expected):
        assert float32_value(words, order) == expected
    else:
        with pytest.raises(ValueError, match="not a finite number"):
            float32_value(words, order)


@pytest.mark.parametrize("text", ["1e999", "-1e999", "9" * 400, "nan", "inf", "-Infinity", "9.91E37", "9.9E37"])
def test_no_text_on_a_wire_is_read_as_what_is_not_finite(text: str) -> None:
    def beyond(read, *arguments) -> bool:
        try:
            return all(abs(found) <= 9.91e37 for found in np.ravel(read(*arguments)))
        except ValueError:
            return True

    assert beyond(number, text)
    assert beyond(read_angle, text)
    assert beyond(read_numbers, text, 1)
    assert beyond(read_number, text.upper().encode())


def test_one_bad_reading_is_passed_over_and_two_in_a_row_are_a_fault() -> None:
    by = channel()
    assert accepted(by, [20.0, 320.0, 20.1, math.nan, 20.2]) == [20.0, 20.1, 20.2]
    assert by.problem == ""
    by = channel()
    assert accepted(by, [20.0, 320.0, 320.0, 20.1]) == [20.0, 20.1]
    assert by.problem.startswith(
        "it was read as 320 °C, outside the possible range, and the reading before it was implausible too."
    )
    by = channel()
    accepted(by, [math.nan, math.nan])
    assert by.problem.startswith("it was read as not-a-number, and")


def test_limits_of_the_bench_file_that_are_wider_make_more_possible(tmp_path: Path) -> None:
    bench = load_bench(copy_bench(tmp_path, ("max: 105 °C}\n    stale", "max: 330 °C}\n    stale"))).bench
    assert accepted(channel(bench=bench), [320.0, 320.1]) == [320.0, 320.1]


# Jumps


@pytest.mark.parametrize(("jump_c", "is_believed"), [(5.9, True), (6.1, False), (-6.1, False)])
def test_a_jump_is_what_the_sensor_cannot_follow(jump_c: float, is_believed: bool) -> None:
    by = channel()
    assert (accepted(by, [20.0, 20.0 + jump_c])[-1] != 20.0) == is_believed
    (rejected,) = channel().take([Reading(0.0, 20.0), Reading(1.0, 60.0)], 1.0)[1]
    assert rejected.why == "was read as 60 °C 1 s after 20 °C, faster than it can change"


def test_after_a_gap_it_may_have_changed_by_as_much_as_the_time_allows() -> None:
    assert accepted(channel(), [20.0, 84.0], every_s=60.0) == [20.0, 84.0]
    assert accepted(channel(), [20.0, 86.0], every_s=60.0) == [20.0]


def test_a_sensor_that_has_come_off_and_reads_the_room_is_a_fault_at_the_second_reading() -> None:
    by = channel(AIR)
    assert accepted(by, [60.0, 22.0, 22.1], every_s=10.0) == [60.0]
    assert "was read as 22.1 °C 20 s after 60 °C" in by.problem


def test_the_bench_file_says_how_steep_it_may_be(tmp_path: Path) -> None:
    bench = with_keys(tmp_path, "steepest: 600 °C/min")
    assert accepted(channel(bench=bench), [20.0, 34.0]) == [20.0, 34.0]
    assert accepted(channel(bench=bench), [20.0, 36.0]) == [20.0]


def test_set_points_and_what_is_no_temperature_may_jump_and_stand(tmp_path: Path) -> None:
    for source, unit in ((SET_POINT, "°C"), ("supply.voltage", "V")):
        assert rule_of(source, unit, BENCH) == Rule(stale_after_s=stale_after_s(source, BENCH))
    by = Channel("it", "V", Rule())
    assert accepted(by, [15.0, 0.0, *[0.0] * 20_000]) == [15.0, 0.0, *[0.0] * 20_000]
    assert by.problem == ""


# Standing still


def standing(bench: BenchFile = BENCH, *, step_c: float = 0.01, hours: float = 1.1, source: str = UNIT) -> str:
    by = channel(source, bench)
    accepted(by, [20.0, 20.0 + step_c, *[20.0] * int(hours * 360)], every_s=10.0)
    return by.problem


def test_one_value_for_ever_is_a_fault_of_what_resolves_noise() -> None:
    assert standing().startswith("it has been constant at 20 °C for 60 min, although new readings arrive.")
    assert standing(source=AIR)
    assert standing(hours=0.9) == ""


def test_what_resolves_no_noise_may_stand_still() -> None:
    assert standing(step_c=0.1, hours=10) == ""


def test_the_bench_file_says_how_long_it_may_stand_still(tmp_path: Path) -> None:
    bench = with_keys(tmp_path, "changes_within: 2 min")
    by = channel(bench=bench)
    assert accepted(by, [20.0] * 121)
    assert by.problem == ""
    by.take([Reading(121.0, 20.0)], 121.0)
    assert "has been constant at 20 °C for 2 min" in by.problem
    assert standing(with_keys(tmp_path / "longer", "changes_within: 12 h"), hours=10) == ""


@settings(max_examples=20)
@given(st.integers(0, 2**32))
def test_a_simulated_thermometer_at_rest_never_stands_for_two_minutes(seed: int) -> None:
    """Noise of half a step, the true value in the middle of it: of 0.68 the next reading is the same."""
    random = np.random.default_rng(seed)
    values = np.round(20.0 + 0.005 * random.standard_normal(1000), 2)
    by = Channel("it", "°C", Rule(changes_within_s=120.0))
    assert len(accepted(by, values.tolist())) == 1000
    assert by.problem == ""


# In a monitor


def watched(folder: Path, key: str, values: Sequence[float], role: str = "counter"):
    """What a monitor showed while it took these values, what it found wrong, and the journal and the readings kept."""
    every_s = 1.0 if role == "counter" else 10.0
    shown, device = [], Scripted(*({key: [Reading(every_s * number, value)]} for number, value in enumerate(values)))
    folder.mkdir(exist_ok=True)
    writer = RunWriter(folder)

    async def main():
        monitor = Monitor(
            Rig({role: device}), BENCH, Interlocks({}, BENCH), Journal(writer), lambda *found: shown.append(found)
        )
        monitor.start()
        await asyncio.sleep((len(values) - 0.5) * every_s)
        await monitor.stop()
        return monitor.fault.result() if monitor.fault.done() else None

    try:
        fault = run(main(), AS_FAST_AS_POSSIBLE)
    finally:
        writer.close()
    name = "unit_temperature" if key == "Temperatures.Unit" else f"{role}.{key}"
    with RunReader(folder) as reader:
        recorded = reader.series(name).values if shown else np.empty(0)
        return shown, fault, list(reader.events("doubted")), recorded


@pytest.mark.parametrize("bad", [math.nan, NAN_PAYLOAD, math.inf, -math.inf, 320.0, 1e300, -273.2, 60.0])
def test_what_is_not_believed_is_in_the_journal_and_nowhere_else(tmp_path: Path, bad: float) -> None:
    values = [20.0, 20.01, bad, 20.02, bad, 20.0]
    shown, fault, rejected, kept = watched(tmp_path, "Temperatures.Unit", values)
    assert fault is None
    assert (
        kept.tolist()
        == [reading.value for _, reading in shown if isinstance(reading, Valid)]
        == [20.0, 20.01, 20.02, 20.0]
    )
    assert [event.data["reading"] for event in rejected] == ["unit_temperature"] * 2
    json.dumps([event.data for event in rejected], allow_nan=False)


@pytest.mark.parametrize("bad", [math.nan, 320.0, 60.0])
def test_twice_in_a_row_it_is_a_fault(tmp_path: Path, bad: float) -> None:
    _, fault, _, kept = watched(tmp_path / "unit", "Temperatures.Unit", [20.0, bad, bad, bad, 20.0])
    assert str(fault).startswith("unit_temperature was read as ")
    assert kept.tolist() == [20.0]
    _, fault, _, _ = watched(tmp_path / "air", "process_value", [20.0, bad, bad], role="chamber")
    assert str(fault).startswith("chamber.process_value was read as ")


def test_a_thermometer_that_nobody_has_named_may_be_connected_to_nothing(tmp_path: Path) -> None:
    _, fault, rejected, _ = watched(tmp_path, "Temperatures.Converter", [320.0] * 50)
    assert fault is None
    assert len(rejected) == 2, "told, and not for ever"


@pytest.mark.parametrize("judged", [True, False])
def test_a_thermometer_that_an_interlock_judges_cannot_fail_unnoticed(tmp_path: Path, judged: bool) -> None:
    key = "Temperatures.Converter"
    entry = ReadingInterlock.model_validate({"reading": f"counter.{key}", "above": "60 °C", "then": "abort"})
    interlocks = Interlocks({"hot": entry} if judged else {}, BENCH)
    device = Scripted(*({key: [Reading(float(number), 320.0)]} for number in range(20)))
    writer = RunWriter(tmp_path)

    async def main() -> bool:
        monitor = Monitor(Rig({"counter": device}), BENCH, interlocks, Journal(writer), lambda *_: None)
        monitor.start()
        await asyncio.sleep(10)
        await monitor.stop()
        return monitor.fault.done()

    try:
        assert run(main(), AS_FAST_AS_POSSIBLE) == judged
    finally:
        writer.close()


def test_the_store_takes_nothing_that_is_no_number(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path)
    for bad in (math.nan, math.inf, -math.inf):
        with pytest.raises(StoreError, match="it: a reading was not a number"):
            writer.readings("it", "V", [Valid(0.0, 1.0, 1), Valid(1.0, bad, 2)])
        with pytest.raises(StoreError, match="it: a reading was not a number"):
            writer.samples("it", "steps/acquire", [Valid(0.0, bad, 1)])
    writer.close()
