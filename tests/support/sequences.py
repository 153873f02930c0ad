"""Small sequences for tests, on the shipped simulated bench."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from bench.config.bench import load_bench
from bench.config.models import BenchFile
from bench.errors import InputError
from bench.sequence.load import load_judged_plan
from bench.sequence.plan.plan import Plan

ROOT = Path(__file__).parents[2]
BENCH: BenchFile = load_bench(ROOT / "config/simulated.yaml").bench
# What a sequence needs besides its steps. It follows them, so that a body begins in line 1.
TAIL = """\
schema: itb-sequence/1
title: Test
needs:
  chamber: thermal_chamber
  head: positioner
  counter: pulse_counter
  supply: power_supply
  source: current_source
  unit_temperature: thermometer
"""


def steps(*lines: str) -> str:
    """Steps in flow style, the first of them in line 2, column 5."""
    return "steps:\n" + "".join(f"  - {line}\n" for line in lines)


def load_plan(path: Path, bench: BenchFile | None, **options: Any) -> Plan:
    """The plan of a file, without its warnings."""
    return load_judged_plan(path, bench, **options)[0]


def plan_of(folder: Path, body: str, *, tail: str = TAIL, bench: BenchFile | None = BENCH, **options: Any) -> Plan:
    """The plan of a sequence; `options` are those of load_plan."""
    path = folder / "s.yaml"
    path.write_text(body + tail, "utf-8")
    return load_plan(path, bench, **options)


def problems_of(folder: Path, body: str, **options: Any) -> list[str]:
    """All that is wrong with a sequence, each problem `line:column: what` as its file is always the same."""
    with pytest.raises(InputError) as caught:
        plan_of(folder, body, **options)
    return [problem.replace(f"{folder / 's.yaml'}:", "") for problem in caught.value.problems]


# Shipped sequences that are for benches of their own, and which these are; all others are for the simulated ones.
ELSEWHERE = {
    "gyro_range": ("gyro",),
    "gyro_response": ("gyro",),
    "gyro_sweep": ("gyro",),
    "table_full": ("table_imu", "table_imu_telemetry"),
    "accel_range": ("centrifuge",),
    "accel_response": ("response",),
    "accel_sweep": ("response",),
    "indexing_static": ("indexing", "indexing_pulses", "indexing_telemetry"),
    "imu_24_position": ("imu", "imu_telemetry"),
    "imu_start_up": ("imu", "imu_telemetry"),
    "indexing_three_axes": ("indexing_three_axes",),
    "imu_two_mountings": ("imu_two_axis",),
    **dict.fromkeys(("channel_full", "channel_gravity", "channel_skew", "channel_source"), ("channel",)),
    "channel_imu": ("channel_imu", "channel_imu_telemetry"),
}
