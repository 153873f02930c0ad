"""A run at the level of records against the same run through all wires."""

import numpy as np

from bench.app.request import RunRequest
from bench.config.bench import load_bench
from campaigns.truth.campaign import full_bench
from campaigns.truth.channel import compared
from campaigns.truth.replay import replayed, template_of

SHORT = (
    "low=20 °C", "high=26 °C", "ramp_rate=30 °C/h", "return_rate=3 °C/min", "time_constant=20 s", "point=1 min",
    "warm_up=30 min",
)  # fmt: skip


def test_a_ramp_that_begins_while_it_is_acquired_is_replayed(tmp_path):
    """It does so some milliseconds after its acquisition."""
    bench = full_bench(tmp_path / "config", "channel")
    template = template_of(
        RunRequest("channel_gravity", bench=str(bench), seed=3, settings=SHORT, runs=tmp_path / "runs")
    )
    (data,) = template.data.values()
    ramp = next(each for each in data.acquisitions if each.set_c != each.set_from_c)
    assert any(ramp.begin_s < stimulus.at_s < ramp.end_s for stimulus in template.stimuli)
    again = replayed(template, load_bench(bench).bench, seed=3)
    warm_c = next(level["temperature_c"] for key, level in again.truth["levels"].items() if key.endswith(ramp.step))
    assert np.ptp(warm_c) > 0.9 * np.ptp(ramp.temperatures_c["converter_temperature"])
    comparisons = compared(again.truth, again.results)
    assert "rate/temperature_coefficient@up_1g" in comparisons
    assert max(abs(each.ratio) for each in comparisons.values()) < 4.5
