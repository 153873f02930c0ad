"""Which devices of a bench a run cannot do without."""

from __future__ import annotations

import pytest

from bench.app.request import RunRequest, load_checked
from bench.sequence.plan.used import devices_used
from tests.support.runs import ROOT


@pytest.mark.parametrize(
    ("sequence", "bench", "unused"),
    [
        ("smoke", "simulated", {"source"}),
        ("tumble_static", "simulated", {"source"}),
        ("tumble_static", "volts", set()),
        ("channel_full", "channel", set()),
        ("threshold_resolution", "simulated", {"chamber", "source"}),
        ("imu_24_position", "imu", set()),
    ],
)
def test_what_a_sequence_neither_acts_on_nor_reads_is_not_needed(sequence, bench, unused):
    checked = load_checked(RunRequest(sequence, bench=str(ROOT / f"config/{bench}.yaml")))
    assert set(checked.bench.devices) - devices_used(checked.plan, checked.bench) == unused
