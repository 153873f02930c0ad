"""Results do not depend on how frames are handed over: one by one, or by an adapter every 16 ms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.app.execute import execute
from bench.app.request import RunRequest, prepare
from bench.reduce.stored_run import open_run
from bench.runner.quiet import Quiet
from bench.store.decoder import Decoder
from tests.support.runs import ROOT

EVERY_S = 0.016  # the latency timer of common serial adapters
BENCHES = {
    "imu_24_position": "imu", "imu_two_mountings": "imu_two_axis", "channel_full": "channel",
    "channel_imu": "channel_imu", "ramp_dynamic": "simulated",
}  # fmt: skip
DERIVED = ("repeatability", "change", "interpolation", "left")  # differences of results, with small uncertainties
pytestmark = pytest.mark.slow


def in_portions(decode):
    """The decoder, with all arrivals at the end of their portion."""

    def decoded(self, block):
        found = decode(self, block).items()
        return {name: replace(each, host_s=np.ceil(each.host_s / EVERY_S) * EVERY_S) for name, each in found}

    return decoded


def reduced(folder):
    with open_run(folder) as run:
        return {(unit.place, each.id): each for unit in run.evaluate().units for each in unit.findings}


@pytest.mark.parametrize("sequence", BENCHES)
def test_results_do_not_depend_on_the_adapter(tmp_path, monkeypatch, sequence):
    bench = str(ROOT / f"config/{BENCHES[sequence]}.yaml")
    request = RunRequest(sequence, bench=bench, preset="quick", runs=tmp_path, no_report=True)
    folder = execute(prepare(request), Quiet()).path
    one_by_one = reduced(folder)
    for what in ("outputs", "positions"):
        monkeypatch.setattr(Decoder, what, in_portions(getattr(Decoder, what)))
    found = reduced(folder)
    assert found.keys() == one_by_one.keys()
    changed = {
        key: abs(found[key].value - each.value) / each.u
        for key, each in one_by_one.items()
        if each.u and each.id.rpartition("/")[2].partition("@")[0] not in DERIVED
    }
    assert len(changed) >= 5
    assert {key: ratio for key, ratio in changed.items() if not ratio < 1} == {}
