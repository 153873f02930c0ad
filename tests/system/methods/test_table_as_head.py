"""A rate table in its position mode where a sequence wants an indexing head."""

import pytest

from bench.store.reader import RunReader
from campaigns.truth.campaign import compare_one
from tests.support.runs import copy_bench, read_json, run_short

ENSEMBLE = """\
    driver: aerotech_ensemble
    connection: sim+tcp://127.0.0.1:8000
    options: {axis: X, rate: 20 °/s, settle: {band: 1 arcsec, hold: 1 s}}
    identity: {serial: SIM-HEAD-01}
    limits:
      angle: {min: -5°, max: 365°}
      rate: {max: 30 °/s}
"""
ACUTROL = """\
    driver: acutronic_acl
    connection: sim+tcp://127.0.0.1:9878
    options: {axis: 1, rate: 20 °/s, acceleration: 40 °/s², settle: {band: 1 arcsec, hold: 1 s}}
    identity: {model: Acutrol3000}
    limits:
      rate: {max: 30 °/s}
      acceleration: {max: 40 °/s²}
      frequency: {max: 1 Hz}
"""
DWELLS = ("temperatures=[20 °C, 45 °C, 20 °C]", "warm_up=0 s", "soak=30 min", "gate=10 s", "ramp_rate=3 °C/min")


@pytest.fixture(scope="module")
def tumbled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    bench = copy_bench(folder / "config", (ENSEMBLE, ACUTROL))
    return run_short(folder, bench=bench, preset="quick", settings=DWELLS)


def test_a_tumble_on_an_acutrol_passes_and_agrees_with_the_truth(tumbled):
    assert (tumbled.outcome.how, tumbled.problems, tumbled.results.verdict) == ("completed", [], "PASS")
    assert read_json(tumbled, "manifest.json")["instruments"]["head"]["model"] == "Acutrol3000"
    comparisons = list(compare_one(tumbled.path, read_json(tumbled, "results.json")))
    assert {"K0", "K1", "misalignment"} <= {comparison.quantity for comparison in comparisons}
    for comparison in comparisons:
        assert abs(comparison.ratio) < 4, comparison


def test_it_went_round_within_a_turn_and_ended_at_rest(tumbled):
    with RunReader(tumbled.path) as reader:
        angles_deg, rates_dps = reader.series("head.angle").values, reader.series("head.rate").values
    assert -1.0 < angles_deg.min() <= 0.0  # on its way from below
    assert 271.0 <= angles_deg.max() < 272.0
    assert rates_dps[-1] == 0.0
