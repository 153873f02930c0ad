"""Counters against the rest of a bench file: their bus, and the encoders that they latch."""

import shutil
from types import SimpleNamespace

import pytest

from bench.config.bench import load_bench
from bench.config.checks_counters import files_of_one_name
from bench.errors import InputError
from drivers.can.dbc_outline import frames_bits
from tests.support.laboratory import ROOT


def reported(folder, *edits, dbc=(), name="response"):
    """What is wrong with a bench with a rate table, its text edited; without the file's name."""
    shutil.copytree(ROOT / "config", folder, dirs_exist_ok=True)
    for path, changes in ((folder / f"{name}.yaml", edits), (folder / f"{name}.dbc", dbc)):
        text = path.read_text("utf-8")
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new)
        path.write_text(text, "utf-8")
    try:
        load_bench(folder / f"{name}.yaml")
    except InputError as error:
        return [problem.split(f"{name}.yaml:", 1)[1].split(": ", 1)[1] for problem in error.problems]
    return []


def test_the_longest_frames_are_counted():
    text = "BO_ 256 A: 8 X\nBO_ 2147483904 B: 8 X\nBO_ 5 C: 0 X\nBO_ 6 D 8\n"
    assert frames_bits(text) == {"A": 135, "B": 160, "C": 55}  # Davis and others 2007, table 1


@pytest.mark.parametrize(("bitrate", "period", "share"), [(1_000_000, "1 ms", ""), (500_000, "1 ms", "77 %"),
                                                          (1_000_000, "400 µs", "96 %")])  # fmt: skip
def test_frames_that_fill_the_bus_are_refused(tmp_path, bitrate, period, share):
    found = reported(tmp_path, ("bitrate=1000000", f"bitrate={bitrate}"), ("period: 1 ms", f"period: {period}"))
    if share in ("", "77 %"):
        assert found == []
    else:
        assert found == [
            "its frames take up to 962500 bit/s, 96 % of the bus and more than 80 %: "
            "lengthen the period, or raise the bitrate of the connection"
        ]


def test_a_bus_whose_bit_rate_is_not_told_is_not_judged(tmp_path):
    assert reported(tmp_path, ("?bitrate=1000000", ""), ("period: 1 ms", "period: 400 µs")) == []


def test_an_encoder_is_that_of_an_axis(tmp_path):
    (problem,) = reported(tmp_path, ("        table: {position", "        tabel: {position"))
    assert problem == "'tabel' drives no axis of the fixture; did you mean 'table'?"


def test_an_encoder_must_not_come_half_round_between_two_latches(tmp_path):
    short = ("Position : 0|32@1+", "Position : 0|16@1+")
    assert reported(tmp_path / "short", dbc=(short,)) == []  # 2160 °/s are 21600 counts in 1 ms
    (problem,) = reported(tmp_path / "shorter", dbc=((short[0], short[1].replace("16@", "15@")),))
    assert problem == (
        "its signal has 15 bits; at 2160 °/s it counts 21600 in a period, half its range or more: shorten the "
        "period, or use a longer signal"
    )


def test_a_signal_of_an_encoder_is_in_the_dbc(tmp_path):
    (problem,) = reported(tmp_path, ("position: Encoder.Position", "position: Encoder.Positoin"))
    assert problem == "position: response.dbc has no signal 'Encoder.Positoin'; did you mean 'Encoder.Position'?"


TELEMETRY = "table_telemetry"


def test_the_encoder_is_on_the_bus_of_the_samples(tmp_path):
    (problem,) = reported(tmp_path, ("telemetry?bitrate=1000000", "telemetry?bitrate=250000"), name=TELEMETRY)
    assert problem.startswith("its frames take up to 250000 bit/s, 100 % of the bus")


def test_an_encoder_latched_with_samples_is_that_of_an_axis_and_of_a_channel(tmp_path):
    (problem,) = reported(tmp_path / "axis", ("        table: {position", "        tabel: {position"), name=TELEMETRY)
    assert problem == "'tabel' drives no axis of the fixture; did you mean 'table'?"
    (problem,) = reported(tmp_path / "channel", ("channel: x}", "channel: y}"), name=TELEMETRY)
    assert problem == "channel: there is no channel 'y'"
    (problem,) = reported(
        tmp_path / "signal", ("position: Encoder.Position", "position: Encoder.Positoin"), name=TELEMETRY
    )
    assert problem.endswith("has no signal 'Encoder.Positoin'; did you mean 'Encoder.Position'?")
    short = ("Position : 0|32@1+", "Position : 0|15@1+")
    (problem,) = reported(tmp_path / "short", dbc=(short,), name=TELEMETRY)
    assert problem.startswith("its signal has 15 bits; at 2160 °/s it counts 21600 in a period, half its range")


@pytest.mark.parametrize(("second", "problems"), [("BU_:\n", 0), ("BU_: Other\n", 1)])
def test_different_files_of_one_name_are_refused(tmp_path, second, problems):
    devices = {}
    for role, text in (("left", "BU_:\n"), ("right", second)):
        path = tmp_path / role / "bus.dbc"
        path.parent.mkdir()
        path.write_text(text, "utf-8")
        devices[role] = SimpleNamespace(files={"dbc": path})
    found = list(files_of_one_name(SimpleNamespace(devices=devices)))
    assert len(found) == problems
    assert [place for place, _ in found] == [("devices", "right", "options", "dbc")] * problems
    assert "".join(what for _, what in found).count("rename one") == problems
