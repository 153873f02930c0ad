"""Settings of a station: paths beside the file, names of benches and sequences, messages."""

import shutil

import pytest

from bench.errors import InputError
from bench.station.settings import DEMO, bench_name, read_station
from tests.support.how_to import FOLDER, STATION, blocks
from tests.support.runs import ROOT


def test_the_settings_of_the_page_name_benches_beside_them(tmp_path):
    text = next(yaml for _, yaml in blocks(FOLDER / "station.md") if yaml.startswith(STATION))
    for folder in ("config", "sequences"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    (tmp_path / "station.yaml").write_text(text, "utf-8")
    found = read_station(tmp_path / "station.yaml", tmp_path / "own")
    assert found.titles == {"a": "Bench A", "b": found.bench("b").bench.title}
    assert found.benches["a"] == tmp_path / "config/simulated.yaml"
    assert found.runs == tmp_path / "runs"
    assert found.sequence_file("smoke") == tmp_path / "sequences/smoke.yaml"


def test_without_settings_there_is_the_simulated_bench(tmp_path):
    found = read_station(None, tmp_path)
    assert list(found.benches) == [DEMO]
    assert found.bench(DEMO).bench.is_simulated


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("benches: {}\n", r"station.yaml:2:1: benches"),
        ("benches: {A b: {file: simulated}}\n", "A b"),
        ("benches: {a: {file: nowhere}}\n", "no such bench"),
        ("benches: {a: {fil: simulated}}\n", "did you mean"),
    ],
)
def test_wrong_settings_are_refused_with_their_place(tmp_path, text, message):
    (tmp_path / "station.yaml").write_text(f"{STATION}{text}", "utf-8")
    with pytest.raises(InputError, match=message):
        read_station(tmp_path / "station.yaml", tmp_path)


@pytest.mark.parametrize("name", ["../smoke", "smok", "smoke.yaml", "/etc/passwd", ""])
def test_only_sequences_of_the_station_have_a_file(tmp_path, name):
    with pytest.raises(InputError, match=r"no (sequence|name)"):
        read_station(None, tmp_path).sequence_file(name)


@pytest.mark.parametrize(
    ("file", "name"),
    [("config/simulated.yaml", "simulated"), ("My Bench-2.yaml", "my_bench_2"), ("3.yaml", "bench_3")],
)
def test_a_bench_is_named_after_its_file(file, name):
    assert bench_name(file) == name
