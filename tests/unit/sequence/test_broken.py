"""Sequences with one fault each: tests/broken/*.yaml begin with what the checker must say, good/*.yaml with nothing.

Those that call others stand in calls/, beside what they call.
"""

from __future__ import annotations

import pytest

from bench.config.bench import load_bench
from bench.config.fixture import AngleRange
from bench.errors import InputError
from bench.sequence.checks.output import warning_line
from bench.sequence.checks.rules import every_rule
from bench.sequence.load import load_judged_plan
from tests.support.sequences import BENCH, ELSEWHERE, ROOT

FOLDER = ROOT / "tests/broken"
_FORBIDDEN = (AngleRange(min="40°", max="50°"),)
BY_HAND = load_bench(ROOT / "config/by_hand.yaml").bench
CHANNEL = load_bench(ROOT / "config/channel.yaml").bench
CHANNEL_IMU = load_bench(ROOT / "config/channel_imu.yaml").bench
IMU = load_bench(ROOT / "config/imu.yaml").bench
TWO_AXES = load_bench(ROOT / "config/imu_two_axis.yaml").bench
FORBIDS = BENCH.model_copy(update={"fixture": BENCH.fixture.model_copy(update={"forbidden": _FORBIDDEN})})
_UNKNOWN = {name: place.model_copy(update={"nominal": None}) for name, place in BENCH.places.items()}
WITHOUT_NOMINAL = BENCH.model_copy(update={"places": _UNKNOWN})
RESPONSE, TABLE = (load_bench(ROOT / f"config/{name}.yaml").bench for name in ("response", "rate_table"))
CUBE, SENT_IMU = (load_bench(ROOT / f"config/{name}.yaml").bench for name in ("table_imu", "imu_telemetry"))
INDEXING, GYRO, ON_AN_ARM = (
    load_bench(ROOT / f"config/{name}.yaml").bench for name in ("indexing", "gyro", "centrifuge")
)
SENT, VOLTS = (load_bench(ROOT / f"config/{name}.yaml").bench for name in ("table_telemetry", "gyro_volts"))
_TELEMETRY = SENT.devices["telemetry"]
_UNLATCHED = _TELEMETRY.model_copy(update={"options": _TELEMETRY.options.model_copy(update={"positions": {}})})
BENCHES = {  # by part of a name
    "unlatched": SENT.model_copy(update={"devices": SENT.devices | {"telemetry": _UNLATCHED}}),
    "of_a_cube": CUBE, "of_a_sent_imu": SENT_IMU, "of_codes": SENT, "of_volts": VOLTS,
    "forbidden": FORBIDS, "without_nominal": WITHOUT_NOMINAL, "unsuited_ramp": CHANNEL, "no_ammeter": CHANNEL,
    "on_a_table": RESPONSE, "on_indexing": INDEXING, "of_a_gyro": GYRO, "on_an_arm": ON_AN_ARM,
    "between_teeth": BY_HAND, "without_encoder": TABLE, "unreachable_attitude": TWO_AXES, "of_an_imu": IMU,
    "channel_left_out": CHANNEL_IMU, "source_without_channel": CHANNEL_IMU,
}  # fmt: skip
BROKEN = sorted([*FOLDER.glob("*.yaml"), *FOLDER.glob("calls/call_*.yaml")])
GOOD = sorted((FOLDER / "good").glob("*.yaml"))
SHIPPED = sorted((ROOT / "sequences").glob("*.yaml"))


AS_PUBLISHED = {  # what the checker says of the figures of a source
    "gyro_response": ("commensurate-swing", "swept-band"),
    "accel_response": ("too-few-pulses", "commensurate-swing", "swept-band"),
}


def expected_of(path):
    """The comments at the beginning of a file: a line for each message."""
    lines = path.read_text("utf-8").split("\n")
    return [line[2:] for line in lines[: next(n for n, line in enumerate(lines) if not line.startswith("# "))]]


def found_in(path, bench=BENCH, **request):
    """What is said of a file, each line without the file's name; other files by their names alone."""
    try:
        plan, warnings = load_judged_plan(path, bench, **request)
    except InputError as error:
        reported = error.problems
    else:
        reported = [warning_line(warning, plan.document) for warning in warnings]
    return [line.removeprefix(f"{path}:").replace(f"{path.parent}/", "") for line in reported]


def bench_of(path):
    return BENCHES.get(next((part for part in BENCHES if part in path.stem), ""), BENCH)


@pytest.mark.parametrize("path", BROKEN, ids=lambda path: path.stem)
def test_a_broken_sequence_is_told_its_one_fault_at_its_place(path):
    (expected,) = expected_of(path)
    assert found_in(path, bench_of(path)) == [expected]


@pytest.mark.parametrize("path", GOOD, ids=lambda path: path.stem)
def test_a_good_sequence_is_told_nothing(path):
    assert found_in(path, bench_of(path)) == []


def test_there_are_sequences_for_every_rule():
    reported = [expected for path in BROKEN for expected in expected_of(path)]
    assert len(reported) >= 80
    assert len(GOOD) >= 10
    for rule in every_rule():
        ours = [expected for expected in reported if expected.endswith(f" [{rule.name}]")]
        assert ours, rule.name
        assert all((" warning: " in expected) == (rule.severity == "warning") for expected in ours)


@pytest.mark.parametrize("path", [path for path in SHIPPED if path.stem not in ELSEWHERE], ids=lambda path: path.stem)
@pytest.mark.parametrize("bench", sorted((ROOT / "config").glob("simulated*.yaml")), ids=lambda path: path.stem)
def test_a_shipped_sequence_is_told_nothing_on_the_benches_that_it_is_for(path, bench):
    loaded = load_bench(bench).bench
    plan, warnings = load_judged_plan(path, loaded)
    assert warnings == ()
    for preset in plan.sequence.presets:
        assert found_in(path, loaded, preset=preset) == []


@pytest.mark.parametrize(("name", "bench"), [(name, bench) for name, benches in ELSEWHERE.items() for bench in benches])
def test_a_shipped_sequence_is_told_nothing_on_a_bench_of_its_own(name, bench):
    loaded = load_bench(ROOT / "config" / f"{bench}.yaml").bench
    path = ROOT / "sequences" / f"{name}.yaml"
    plan, _ = load_judged_plan(path, loaded)
    for preset in (None, *plan.sequence.presets):
        rules = AS_PUBLISHED.get(name, ()) if preset == "as_published" else ()
        warned = [line.rpartition("[")[2].rstrip("]") for line in found_in(path, loaded, preset=preset)]
        assert warned == list(rules), preset
