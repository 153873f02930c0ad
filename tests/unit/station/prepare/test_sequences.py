"""Catalogue of sequences: what a person needs to choose one."""

import shutil

import pytest

from bench.station.prepare.sequences import Sequences, head_of
from bench.station.settings import read_station
from tests.support.runs import ROOT


@pytest.fixture
def station(tmp_path):
    (tmp_path / "own").mkdir()
    shutil.copy(ROOT / "sequences/smoke.yaml", tmp_path / "own/smoke.yaml")
    (tmp_path / "own/broken.yaml").write_text("schema: itb-sequence/1\ntitle: [\n")
    return Sequences(read_station(None, tmp_path / "station")._replace(sequences=tmp_path / "own"))


def test_parameters_have_their_units_bounds_and_defaults(station):
    found = station.named("tumble_static")
    offset, positions = (
        next(each for each in found.parameters if each.name == name) for name in ("angle_offset", "positions")
    )
    assert (offset.default, offset.low, offset.high, offset.unit, offset.is_list) == ("1°", "0°", "5°", "°", False)
    assert positions.default == "[0°, 90°, 180°, 270°, 270°, 180°, 90°, 0°]"
    assert found.head.startswith("Static temperature tumble of a quartz accelerometer")
    assert "$schema" not in found.head
    assert found.needs["head"] == "positioner"


def test_a_preset_replaces_the_defaults_that_it_sets(station):
    found = station.named("tumble_static")
    usual, quick = found.shown_with(None), found.shown_with("quick")
    assert {name for name in usual if usual[name] != quick[name]} == {"temperatures"}
    assert quick["temperatures"].startswith("[20 °C, 45 °C")


def test_the_laboratory_has_its_own_sequences_and_a_broken_one_says_why(station):
    found = {each.name: each for each in station.all()}
    assert found["smoke"].own
    assert not found["tumble_static"].own
    assert "broken.yaml:" in found["broken"].problem


def test_a_changed_file_is_read_again(station, tmp_path):
    before = station.named("smoke").title
    path = tmp_path / "own/smoke.yaml"
    path.write_text(path.read_text().replace(f"title: {before}", "title: Another one"))
    assert station.named("smoke").title == "Another one"


def test_the_head_of_a_file_ends_with_its_first_line_that_is_no_comment():
    assert head_of("# yaml-language-server: x\n# A\n#   b\n#\n\n# no more\n") == "A\n  b"
