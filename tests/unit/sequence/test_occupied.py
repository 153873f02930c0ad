"""Which places of a bench have a unit in a run, and what names for several then stand for."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from bench.app.laboratory import unit_files
from bench.app.request import RunRequest, load_checked, prepare
from bench.config.bench import load_bench
from bench.engine.units import Units
from bench.errors import InputError
from bench.sequence.load import load_sequence
from bench.sequence.plan.unit_places import occupied
from simulators.units.imu_file import ImuFile
from simulators.units.unit_file import UnitFile
from tests.support.runs import ROOT

PATH = ROOT / "config/every_dialect.yaml"
BENCH = load_bench(PATH).bench  # a converter in place a, an inertial unit in place b
THREE = load_bench(ROOT / "config/three_units.yaml").bench


def wish(sequence: str, *units: str, bench: Path = PATH) -> RunRequest:
    return RunRequest(sequence, bench=str(bench), preset="quick", units=units)


@pytest.mark.parametrize(
    ("sequence", "place", "supply", "thermometer"),
    [
        ("channel_full", "a", "converter_supply", "thermostat_temperature"),
        ("imu_24_position", "b", "imu_supply", "accelerometer_temperature"),
    ],
)
@pytest.mark.parametrize("named", [False, True])
def test_units_are_in_the_places_that_are_named_or_that_the_methods_are_for(
    sequence: str, place: str, supply: str, thermometer: str, named: bool
) -> None:
    checked = load_checked(wish(sequence, *([f"{place}=QF-7"] if named else [])))
    assert list(checked.bench.places) == [place]
    assert checked.bench.together == {"supply": (supply,), "unit_temperature": (thermometer,)}
    assert checked.loaded.bench == BENCH, "what is connected and simulated is the whole bench"


def test_units_that_are_not_named_have_serial_numbers_where_they_are() -> None:
    assert prepare(wish("channel_full")).serials == {"a": "SIM-A"}
    assert prepare(wish("imu_24_position")).serials == {"b": "SIM-B"}
    assert prepare(wish("imu_24_position", "b=IMU-7")).serials == {"b": "IMU-7"}


def test_a_run_on_real_instruments_names_its_units(tmp_path: Path) -> None:
    shutil.copytree(PATH.parent, tmp_path / "config")
    path = tmp_path / "config" / PATH.name
    path.write_text(path.read_text("utf-8").replace("sim+tcp://127.0.0.1:2049", "tcp://127.0.0.1:2049"), "utf-8")
    with pytest.raises(InputError, match="needs the serial numbers of its units: --uut PLACE=SERIAL"):
        prepare(wish("imu_24_position", bench=path))
    assert prepare(wish("imu_24_position", "b=IMU-7", bench=path)).serials == {"b": "IMU-7"}


MISPLACED = "place '{}' is for {}, the sequence measures {}; name one with --uut {}=SERIAL"


@pytest.mark.parametrize(
    ("sequence", "units", "reported"),
    [
        ("imu_24_position", ("a=QF-7",), MISPLACED.format("a", "units with one channel", "inertial units", "b")),
        (
            "tumble_static",
            ("a=QF-7", "b=IMU-7"),
            MISPLACED.format("b", "inertial units", "units with one channel", "a"),
        ),
        ("channel_full", ("c=QF-7",), "--uut c=QF-7: the bench has no place 'c'"),
        ("channel_full", ("QF-7",), "--uut QF-7: the bench has places a, b; write --uut PLACE=SERIAL"),
    ],
)
def test_a_unit_where_it_cannot_be_measured_is_refused(sequence: str, units: tuple[str, ...], reported: str) -> None:
    with pytest.raises(InputError) as refused:
        load_checked(wish(sequence, *units))
    assert reported in str(refused.value)


def test_no_place_is_left_out_where_all_are_alike_or_none_is_suited() -> None:
    _, tumble = load_sequence(ROOT / "sequences/tumble_static.yaml")
    _, inertial = load_sequence(ROOT / "sequences/imu_24_position.yaml")
    assert occupied(THREE, tumble) == THREE
    assert occupied(THREE, inertial) == THREE, "so that the rules tell why it is not for them"
    assert occupied(BENCH, tumble.model_copy(update={"results": ()})) == BENCH


def test_a_name_for_several_stands_for_what_is_shared_and_for_what_is_nobodys() -> None:
    shared = THREE.places["c"].model_copy(update={"supply": "supply_a"})
    bench = THREE.model_copy(
        update={
            "places": {**THREE.places, "c": shared},
            "together": {"supply": ("supply_a", "supply_b", "supply_c"), "others": ("temperature_a", "temperature_b")},
        }
    )
    assert bench.with_units_in(["c"]).together == {"supply": ("supply_a", "supply_c")}, "supply_c is nobody's here"
    assert bench.with_units_in(["b", "c"]).together["supply"] == ("supply_a", "supply_b", "supply_c")


def test_what_belongs_to_a_place_without_a_unit_is_not_needed() -> None:
    of = {
        "a": {"converter_supply", "thermostat_temperature", "converter_temperature", "source"},
        "b": {"imu_supply", "accelerometer_temperature", "gyro_temperature"},
    }
    for place, other in ("ab", "ba"):
        units = Units(BENCH, [place])
        assert all(units.is_needed(name) for name in of[place] | {"wall"})
        assert not any(units.is_needed(name) for name in of[other])


def test_another_truth_is_that_of_the_units_in_the_run() -> None:
    files = unit_files(BENCH, ROOT / "config/uut/imu.yaml", ["b"])
    assert isinstance(files["b"], ImuFile)
    assert files["b"].title == "Inertial unit, good"
    assert isinstance(files["a"], UnitFile)
