"""Live curves in a browser: an oscillating axis as an envelope and sample by sample, and the output of each sensor."""

from __future__ import annotations

import math
from contextlib import contextmanager
from itertools import pairwise

import pytest

from tests.support.browser import browsing
from tests.support.station import serving

pytestmark = [pytest.mark.integration, pytest.mark.slow, pytest.mark.peer("chromium", "playwright")]
LONG_MS = 90_000
AMPLITUDE_DEG = 10.0
STATION = """\
schema: itb-station/1
benches:
  {bench}: {{file: {bench}}}
sequences: own
"""
OSCILLATES = f"""\
schema: itb-sequence/1
title: Oscillates
needs: {{table: rate_table, output: output, supply: power_supply}}
steps:
  - {{set: supply, voltage: 15 V, current_limit: 120 mA, output: on}}
  - {{move: table, to: 0°, way: nearest}}
  - oscillate: table
    amplitude: {AMPLITUDE_DEG}°
    frequency: 0.5 Hz
    during:
      - {{acquire: output, for: 10 min, label: swing}}
teardown:
  - {{set: supply, output: off}}
  - {{move: table, to: 0°, way: nearest}}
"""
RESTS = """\
schema: itb-sequence/1
title: Rests
needs: {output: output, supply: power_supply}
steps:
  - {set: supply, voltage: 28 V, current_limit: 1 A, output: on}
  - {orient: {x: up, z: north}}
  - {acquire: output, for: 30 min, label: still}
teardown:
  - {set: supply, output: off}
"""
# Keeps the plots that the page makes, with their titles and data, for the test to look into.
KEEP = """
let made;
Object.defineProperty(window, 'uPlot', {
  get: () => made,
  set: (plot) => {
    made = class extends plot {
      constructor(...given) { super(...given); (window.kept ??= []).push(this); }
    };
  },
});
"""
# Columns of the newest plot with a title, without instants: mean, low and high of each channel.
COLUMNS = """title => {
  const found = (window.kept ?? []).filter(each => each.root.closest('#plots figure')?.textContent.includes(title));
  return found.length ? found.at(-1).data.slice(1).map(column => [...column]) : [];
}"""


@contextmanager
def shown(tmp_path, bench, text, unit, speed):
    """The page of a run of this text, with its plots kept; the run is aborted at the end."""
    with watched(tmp_path, bench, text) as station, browsing() as seen:
        seen.page.add_init_script(KEEP)
        seen.log_in(station.url, station.code)
        item = station.submit("one", bench=bench, units={"a": unit}, speed=speed)
        yield station, seen.page
        aborted(station, item)
        assert seen.complaints == []


def watched(tmp_path, bench, text):
    """A station whose only sequence is this text."""
    (tmp_path / "own").mkdir()
    (tmp_path / "own/one.yaml").write_text(text)
    (tmp_path / "station.yaml").write_text(STATION.format(bench=bench))
    return serving(tmp_path, "station.yaml")


def aborted(station, item):
    run = station.get(f"queue/{item['id']}")["run"]
    station.post(f"runs/{run}/abort")
    assert station.ended(item)["outcome"] == "aborted"


def known(column):
    return [value for value in column if value is not None]


def test_an_oscillation_is_an_envelope_and_in_the_scope_each_sample(tmp_path):
    with shown(tmp_path, "gyro", OSCILLATES, "QG-0001", "5") as (station, page):
        page.wait_for_selector("text=Oscillating", timeout=LONG_MS)
        page.wait_for_selector("#plots canvas", timeout=LONG_MS)

        def envelope():
            _, low, high = (page.evaluate(COLUMNS, "Angle / °") or [[], [], []])[:3]  # none before the first curve
            return max(known(high), default=0.0) - min(known(low), default=0.0)

        station.until(lambda: envelope() > 1.9 * AMPLITUDE_DEG, within_s=60)
        mean, low, high = page.evaluate(COLUMNS, "Angle / °")[:3]
        assert envelope() == pytest.approx(2 * AMPLITUDE_DEG, rel=0.05)
        swings = [n for n in range(len(mean)) if (high[n] or 0.0) - (low[n] or 0.0) > AMPLITUDE_DEG]
        assert swings
        assert [mean[n] for n in swings] == [None] * len(swings), "too few values for a curve"

        page.click("[data-scope]")
        station.until(lambda: len((page.evaluate(COLUMNS, "Angle / °") or [[]])[0]) > 100, within_s=30)
        angles = known(page.evaluate(COLUMNS, "Angle / °")[0])
        assert max(angles) - min(angles) == pytest.approx(2 * AMPLITUDE_DEG, rel=0.02)
        jumps = [abs(b - a) for a, b in pairwise(angles)]
        assert max(jumps) < 2 * AMPLITUDE_DEG * math.pi * 0.5 * 0.03, "every sample is shown"


def test_each_sensor_of_a_unit_that_sends_codes_has_its_curve_and_its_deviation(tmp_path):
    with shown(tmp_path, "imu_telemetry", RESTS, "IMU-0001", "20") as (station, page):
        page.wait_for_selector("#plots canvas", timeout=LONG_MS)
        title = "Output minus expectation"
        station.until(lambda: len(known((page.evaluate(COLUMNS, title) or [[]])[0])) > 10, within_s=60)
        away = page.evaluate(COLUMNS, title)
        outputs = page.evaluate(COLUMNS, "Output / code")
        assert len(away) == 3 * 3
        assert len(outputs) == 3 * 6
        x, y, z = [known(column) for column in away[::3]]
        assert all(max(map(abs, each)) < 0.02 * 52_000 for each in (x, y, z)), "near the nominal unit"
        assert any(abs(value - 52_000) < 0.02 * 52_000 for value in known(outputs[0])), "x is up"
