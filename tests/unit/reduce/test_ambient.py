"""Ambient conditions: least and greatest value of the listed readings, corrected, with their uncertainty."""

import numpy as np
import pytest

from bench.config.bench import load_bench
from bench.figures.languages import language
from bench.reduce.ambient import AmbientRange, ambient_of
from bench.store.reader import Series
from tests.support.runs import copy_bench

CERTIFICATE = (
    "{certificate: T-1, laboratory: none, date: 2026-01-01, due: 2030-12-31, k: 1, U: {offset: 0.3 °C, gain: 1 %},"
    " corrections: [{at: 0 °C, add: 0.5 °C}, {at: 100 °C, add: 0.5 °C}]}"
)


class Readings:
    """Readings of a run by name."""

    def __init__(self, **values):
        self._values = values

    def series(self, name):
        values = np.array(self._values.get(name, []))
        return Series(name, "°C", np.arange(len(values)), values)


@pytest.fixture
def bench_file(tmp_path):
    def made(calibration=""):
        entry = f"{{from: chamber.process_value{calibration}}}"
        edits = (
            ("time_zone: Asia/Shanghai\n", "time_zone: Asia/Shanghai\n  ambient: [room_temperature]\n"),
            ("readings:\n", f"readings:\n  room_temperature: {entry}\n"),
        )
        return load_bench(copy_bench(tmp_path / "config", *edits)).bench

    return made


def test_a_reading_is_corrected_and_has_the_uncertainty_of_its_certificate(bench_file):
    readings = Readings(room_temperature=[21.0, np.nan, 39.5, 20.5])
    (found,) = ambient_of(readings, bench_file(f", calibration: {CERTIFICATE}"))
    assert (found.low, found.high) == (21.0, 40.0)
    assert found.expanded == pytest.approx(2 * np.hypot(0.3, 0.01 * 40))
    assert found.in_words == "room temperature 21.0 to 40.0 °C (U = 1.0 °C, k = 2)"
    with language("zh"):
        assert found.in_words.startswith("室温 21.0 至 40.0 °C")


def test_a_reading_without_a_certificate_says_so_and_one_without_values_is_left_out(bench_file):
    bench = bench_file()
    (found,) = ambient_of(Readings(room_temperature=[21.04, 22.0]), bench)
    assert found == AmbientRange("room_temperature", 21.04, 22.0, "°C", None)
    assert found.in_words == "room temperature 21.0 to 22.0 °C (uncertainty not stated)"
    assert list(ambient_of(Readings(room_temperature=[np.nan]), bench)) == []
