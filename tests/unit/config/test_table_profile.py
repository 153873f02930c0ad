"""Profiles of tables: what is wrong with one is told at its place, and its schema agrees."""

import json
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from bench.config.bench import load_bench
from bench.config.document import read_document
from bench.config.load import load_file
from bench.config.schema import table_profile_schema
from bench.errors import InputError
from drivers.dialects.framed.profile import FrameProfile
from tests.support.framed import PLAIN_FILE
from tests.support.runs import ROOT, copy_bench, read_json, run_short
from tests.unit.config.test_chamber_profile import place_of

SHIPPED = ROOT / "config/tables/fictional.yaml"
TEXT = SHIPPED.read_text("utf-8")
HEAD = "    driver: aerotech_ensemble\n"
OPTIONS = "options: {axis: X, rate: 20 °/s"


def bench_with(folder: Path, profile: str, driver: str = "framed_head") -> Path:
    """The demonstration bench with a head that a profile describes; its other files are where they were."""
    options = "options: {profile: tables/mine.yaml, rate: 20 °/s"
    edits = [(HEAD, f"    driver: {driver}\n"), (OPTIONS, options), ("serial: SIM-HEAD-01", 'serial: "1001"')]
    if driver == "framed_table":
        of_head = "angle: {min: -5°, max: 365°}\n      rate: {max: 30 °/s}"
        of_table = "rate: {max: 30 °/s}\n      acceleration: {max: 40 °/s²}\n      frequency: {max: 1 Hz}"
        edits += [(of_head, of_table), (options, options + ", acceleration: 40 °/s²")]
    path = copy_bench(folder, *edits)
    (folder / "tables/mine.yaml").write_text(profile, "utf-8")
    return path.rename(folder / "bench.yaml")


def test_the_shipped_example_is_a_profile_and_says_that_it_is_made_up() -> None:
    profile = load_file(SHIPPED, FrameProfile)
    assert "FICTIONAL" in TEXT.splitlines()[1]
    assert profile.command_names() == ["stop", "move", "enable", "disable", "rate", "sine", "home", "clear_fault"]
    assert not list(Draft202012Validator(table_profile_schema()).iter_errors(read_document(SHIPPED).value))
    assert not list(Draft202012Validator(table_profile_schema()).iter_errors(PLAIN_FILE))


@pytest.mark.parametrize(
    ("old", "new", "at", "problem"),
    [
        ("header: AA 55", "header: AA 5", "header", "is 'AA 5', expected bytes in hexadecimal, like 'AA 55'"),
        ('bytes: "10"', "bytes: 10", "bytes: 10", "is 10, expected bytes in hexadecimal, like 'AA 55'; put it in"),
        ("type: i32, scale: 0.0001°}", "type: i24, scale: 0.0001°}", "type: i24", "expected 'u8', 'i8'"),
        ("type: i32, scale: 0.0001°}", "type: i32, scale: 0.0001}", "scale: 0.0001}", "0.0001 has no unit"),
        ("type: i32, scale: 0.0001°}", "type: i32, scale: 0.0001 °/s}", "scale: 0.0001 °/s}", "°"),
        ("type: i32, scale: 0.0001°}", "type: i32, scale: 0°}", "angle: {at: 10", "scale is 0"),
        ("answers: {at: 3, type: u8}", "answers: {at: 3, type: i8}", "type: i8", "expected 'u8', 'u16' or 'u32'"),
        ("kind: crc16", "kind: crc8", "kind: crc8", "expected 'sum8', 'xor8'"),
        ("kind: crc16", "kind: xor8", "checksum", "initial, polynomial: only crc16 has this, not xor8"),
        ("polynomial: 0x1021, ", "", "checksum", "crc16 needs its polynomial"),
        ("polynomial: 0x1021", "polynomial: 0x11021", "polynomial", "is '0x11021', expected 16 bits"),
        ("enabled: {at: 27, bit: 0}", "enabled: {at: 27, bit: 8}", "bit: 8", "is 8, expected at most 7"),
        ("moving:", "movng:", "movng", "did you mean 'moving'"),
        ("reaction: 20 ms", "reaction: 20", "reaction", "20 has no unit"),
        ("off: 0, position: 1", "off: 1, position: 1", "mode: {", "one number is used for two modes"),
        ("rate: {at: 14,", "rate: {at: 12,", "at: 12,", "byte 12 is used by angle already"),
        ("counter: {at: 4,", "counter: {at: 1,", "at: 1,", "byte 1 is used by the header already"),
        ("means: amplifier", "bit: 0, means: amplifier", "", ""),
        ("{at: 29, quiet", "{at: 27, quiet", "at: 27, quiet", "byte 27 is used by bits already"),
        ("{at: 29, quiet", "{at: 30, quiet", "at: 30, quiet", "byte 30 is beyond the last before the checksum, 29"),
        ("  length: 6\n", "  length: 3\n", "length: 3\n", "3 bytes are too short for header, checksum and trailer"),
        ("bytes: 23 01", "bytes: 20 01", "enable: {length", "it cannot be distinguished from stop: give it constants"),
        ("\nrequest:", "\ncyclic: {period: 10 ms}\nrequest:", "", "needs either cyclic or request"),
        ("answers: {at: 3", "at_all: {at: 3", "at_all", "unknown key"),
        ("  counter: {at: 3, type: u8}\n", "", "answers", "needs request.counter, which it answers with"),
        ("    at_sine: {at: 27, bit: 4}\n", "", "sine:  ", "needs status.states.at_sine"),
        ("    enabled: {at: 27, bit: 0}\n", "", "enable:", "needs status.states.enabled"),
        ("schema: itb-table/1", "schema: itb-chamber/1", "schema: itb-chamber", "expected 'itb-table/1'"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_at_its_place_in_the_profile(
    tmp_path: Path, old: str, new: str, at: str, problem: str
) -> None:
    assert old in TEXT
    text = TEXT.replace(old, new, 1)
    path = tmp_path / "mine.yaml"
    path.write_text(text, "utf-8")
    if not problem:
        load_file(path, FrameProfile)
        return
    with pytest.raises(InputError) as reported:
        load_file(path, FrameProfile)
    expected = f"{path}:{place_of(text, at)}: " if at else f"{path}:"
    assert [line for line in reported.value.problems if line.startswith(expected) and problem in line], (
        reported.value.problems
    )


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"cyclic": {"period": "5 ms"}, "line": {"baud": 9600}}, r"a status takes 12\.5 ms at 9600 baud"),
        ({"commands_answered": True}, "is for a controller that is polled"),
    ],
)
def test_what_a_controller_that_sends_by_itself_cannot_be(change: dict[str, Any], problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        FrameProfile.model_validate(PLAIN_FILE | change)


def test_a_mistake_in_a_profile_is_told_where_the_bench_file_names_it(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"tables/mine\.yaml:\d+:\d+: reaction"):
        load_bench(bench_with(tmp_path, TEXT.replace("reaction: 20 ms", "reaction: 20")))


@pytest.mark.parametrize(
    ("driver", "old", "new", "problem"),
    [
        ("framed_head", "\nrequest:", "\nangle_wraps: true\nrequest:", "which only framed_table supports"),
        ("framed_table", "  rate: {at: 14, type: i32, scale: 0.0001 °/s}\n", "", "needs commands.rate and status.rate"),
    ],
)
def test_a_profile_fits_its_driver(tmp_path: Path, driver: str, old: str, new: str, problem: str) -> None:
    assert old in TEXT
    load_bench(bench_with(tmp_path, TEXT, driver))
    path = bench_with(tmp_path, TEXT.replace(old, new), driver)
    with pytest.raises(InputError, match=rf"bench\.yaml:\d+:\d+: profile: .*{problem}"):
        load_bench(path)


@pytest.mark.parametrize(
    "angle",
    [{"at": 256, "type": "i32", "scale": "1°"}, {"at": 2, "type": "i24", "scale": "1°"}, {"at": 2, "type": "i32"},
     {"at": 2, "type": "i32", "scale": 1}, {"at": 2, "type": "i32", "scale": "1°", "unit": "°"}],
)  # fmt: skip
def test_what_the_loader_refuses_in_a_number_the_schema_refuses(angle: dict[str, Any]) -> None:
    value = PLAIN_FILE | {"status": PLAIN_FILE["status"] | {"angle": angle}}
    assert list(Draft202012Validator(table_profile_schema()).iter_errors(value))
    with pytest.raises(ValueError, match="angle"):
        FrameProfile.model_validate(value)


def test_the_schema_that_is_shipped_is_the_one_of_the_program() -> None:
    shipped = json.loads((ROOT / "docs/schema/table-profile.schema.json").read_text("utf-8"))
    assert shipped == table_profile_schema()


SEQUENCE = """\
schema: itb-sequence/1
title: There and back
needs: {head: positioner, chamber: thermal_chamber}
steps:
  - {move: head, to: 40°}
  - {move: head, to: 0°}
"""


def test_a_run_on_a_described_head_completes_and_keeps_every_profile(tmp_path: Path) -> None:
    bench = bench_with(tmp_path / "config", TEXT)
    chamber = (ROOT / "config/chambers/fictional.yaml").read_text("utf-8")
    (tmp_path / "config/chambers/mine.yaml").write_text(chamber, "utf-8")
    text = bench.read_text("utf-8").replace("driver: watlow_f4t", "driver: modbus_chamber")
    text = text.replace("{unit_id: 1, loop: 1, word_order: low_first}", "{profile: chambers/mine.yaml}")
    bench.write_text(text, "utf-8")
    sequence = tmp_path / "there_and_back.yaml"
    sequence.write_text(SEQUENCE, "utf-8")
    result = run_short(tmp_path, bench=bench, sequence=str(sequence))
    assert (result.outcome.how, result.problems) == ("completed", [])
    assert (result.path / "mine.yaml").read_text("utf-8") == chamber
    assert (result.path / "head_mine.yaml").read_text("utf-8") == TEXT
    head = read_json(result, "manifest.json")["instruments"]["head"]
    assert (head["model"], head["serial"], head["serial_verified"]) == ("FT-3", "1001", True)
