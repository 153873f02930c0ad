"""The corrections of a current source against the truth: it gives what its table says, and the levels are right.

On the perfect bench, where nothing else is wrong: a rate at a level is that of the noiseless converter at this level.
"""

from unittest import mock

import pytest

from bench.reduce.corrections import Corrections, Table
from bench.reduce.stored_run import open_run
from campaigns.truth.campaign import perfect_bench
from campaigns.truth.channel import compare_channel
from tests.support.runs import run_short

SETTINGS = (
    "low=20 °C", "high=27 °C", "ramp_rate=30 °C/h", "return_rate=3 °C/min", "time_constant=1 min", "point=1 min",
    "source_warm_up=0 s", "levels=[1 g]",
)  # fmt: skip
ROWS = "[{at: -2 mA, add: 900 nA}, {at: 0 A, add: 300 nA}, {at: 2 mA, add: -500 nA}]"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("corrected")
    bench = perfect_bench(folder / "config", "channel")
    text = bench.read_text("utf-8")
    stated = "U: {gain: 0 ppm, offset: 0 nA, drift: 0 ppm/h}"
    assert text.count(stated) == 1
    bench.write_text(text.replace(stated, f"{stated}, corrections: {{current: {ROWS}}}"), "utf-8")
    return run_short(folder / "runs", bench=bench, sequence="channel_source", settings=SETTINGS, speed="max").path


def rates(run):
    with open_run(run) as stored:
        found = compare_channel(run, stored.evaluate().to_json())
    return [each for each in found.values() if each.quantity == "rate"]


def worst(run):
    return max(abs(each.ratio) for each in rates(run))


def as_told():
    return mock.patch.object(Corrections, "current_a", lambda self, role, told_a: told_a)


def backwards():
    honest = Corrections.current_a

    def turned(self, role, told_a):
        tables = {name: Table(table.at, -table.add) for name, table in self.currents.items()}
        return honest(self._replace(currents=tables), role, told_a)

    return mock.patch.object(Corrections, "current_a", turned)


def test_a_rate_is_that_of_the_current_that_the_certificate_says(run):
    assert len(rates(run)) == 1
    assert worst(run) < 4


@pytest.mark.parametrize("mistake", [as_told, backwards])
def test_a_correction_that_is_left_out_or_taken_the_wrong_way_is_seen(run, mistake):
    with mistake():
        assert worst(run) > 100


def test_the_levels_keep_their_names_and_what_was_read_stays(run):
    with open_run(run) as stored:
        results, acquired = stored.evaluate(), stored.data("channel").acquisitions
        journal = [event.data["current_a"] for event in stored.reader.events("step_ended")
                   if event.data.get("role") == "source" and event.data["output"]]  # fmt: skip
    (unit,) = results.units
    assert [level.name for level in unit.detail.levels] == ["src_1g"]
    (rate,) = [each for each in unit.findings if each.id.endswith("/rate@src_1g")]
    given_a = 1.13e-3 + 300e-9 - 800e-9 * 1.13 / 2
    assert rate.at["current_a"] == pytest.approx(given_a, rel=1e-9)
    assert rate.at["level_g"] == pytest.approx(given_a / 1.13e-3, rel=1e-9)
    assert {each.sources_set_a["source"] for each in acquired} == set(journal)
    # With nothing set 300 nA flow, 3 pulse/s at 10 MHz/A: the zero is what the converter makes of nothing.
    (zero,) = [each for each in unit.findings if each.quantity == "zero"]
    assert zero.value == pytest.approx(2.0, abs=0.2)
    assert results.corrections == (
        "source: corrected by +900 nA at -2 mA, +300 nA at 0 mA, -500 nA at 2 mA (certificate SIM-2026-0105).",
    )
