"""Profiles of chambers: what is wrong with one is told at its place, and its schema agrees."""

import json
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from bench.config.bench import load_bench, load_kept_bench
from bench.config.document import read_document
from bench.config.load import load_file
from bench.config.schema import chamber_profile_schema
from bench.errors import InputError
from drivers.dialects.modbus_chamber.description import ModbusChamberOptions
from drivers.dialects.modbus_chamber.profile import ChamberProfile
from tests.support.runs import ROOT, copy_bench

SHIPPED = ROOT / "config/chambers/fictional.yaml"
TEXT = SHIPPED.read_text("utf-8")
F4T = "    driver: watlow_f4t\n"
OPTIONS = "options: {unit_id: 1, loop: 1, word_order: low_first}"


def bench_with(folder: Path, profile: str | None, options: str = "{profile: chambers/mine.yaml}") -> Path:
    """The demonstration bench with a chamber that a profile describes; its other files are where they were."""
    path = copy_bench(folder, (F4T, "    driver: modbus_chamber\n"), (OPTIONS, f"options: {options}"))
    if profile is not None:
        (folder / "chambers/mine.yaml").write_text(profile, "utf-8")
    return path.rename(folder / "bench.yaml")


def place_of(text: str, words: str) -> str:
    """line:column of words in a text."""
    before = text[: text.index(words)]
    return f"{before.count(chr(10)) + 1}:{len(before) - before.rfind(chr(10))}"


def test_the_shipped_example_is_a_profile_and_says_that_it_is_made_up() -> None:
    profile = load_file(SHIPPED, ChamberProfile)
    assert "FICTIONAL" in TEXT.splitlines()[1]
    assert profile.ramp is not None
    assert not list(Draft202012Validator(chamber_profile_schema()).iter_errors(read_document(SHIPPED).value))


@pytest.mark.parametrize(
    ("old", "new", "at", "problem"),
    [
        ("address: 120", "address: 70000", "address: 70000", "is 70000, expected a register address on the wire"),
        ("address: 120", "address: 0x1G", "address: 0x1G", "is '0x1G', expected a register address"),
        ("type: float32, write: 16", "type: float64, write: 16", "type: float64", "expected 'int16', 'uint16'"),
        ("read: 4", "read: 5", "read: 5", "read: is 5, expected 3 or 4"),
        ("scale: 0.01", "scale: 0", "scale: 0}", "is 0, expected more than 0"),
        ("follows: [1]", "folows: [1]", "folows", "did you mean 'follows'"),
        ("start: 1", "start: 7", "start: 7", "is 7, which is none of follows"),
        ("off: [0]", "off: [1]", "follows", "the number 1 is listed twice"),
        ("means: over-temperature", "why: hot", "why", "unknown key"),
        ("{address: 111,", "{address: 110,", "address: 110, type: int16, scale: 0.1}\n\nmode", "by limits.min already"),
        ("{address: 110,", "{address: 103,", "address: 103,", "register 103 is used by set_point_in_force already"),
        ("  per: minute\n", "", "ramp:", "the key 'per' is missing"),
        ("gap: 30 ms", "gap: 30", "gap", "30 has no unit"),
        ("schema: itb-chamber/1", "schema: itb-bench/1", "schema: itb-bench", "expected 'itb-chamber/1'"),
        ("word_order: low_first ", "#", "type: float32, write", "float32 fills two registers: give word_order"),
        ("set_point_in_force", "# set_point_in_force", "ramp:", "needs set_point_in_force as well"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_at_its_place_in_the_profile(
    tmp_path: Path, old: str, new: str, at: str, problem: str
) -> None:
    assert old in TEXT
    text = TEXT.replace(old, new, 1)
    bench = bench_with(tmp_path, text)
    with pytest.raises(InputError) as reported:
        load_bench(bench)
    expected = f"{tmp_path / 'chambers/mine.yaml'}:{place_of(text, at)}: "
    assert [line for line in reported.value.problems if line.startswith(expected) and problem in line], (
        reported.value.problems
    )


@pytest.mark.parametrize("both", [True, False])
def test_the_set_points_that_it_takes_are_stated_once(tmp_path: Path, both: bool) -> None:
    text = TEXT.replace("mode:", "range: {min: -40 °C, max: 90 °C}\n\nmode:")
    if not both:
        text = TEXT[: TEXT.index("limits:")] + TEXT[TEXT.index("mode:") :]
    with pytest.raises(InputError, match="needs either range or limits"):
        load_bench(bench_with(tmp_path, text))


def test_a_file_that_is_not_there_is_told_at_its_place_in_the_bench_file(tmp_path: Path) -> None:
    path = bench_with(tmp_path, None)
    with pytest.raises(InputError, match=r"bench\.yaml:\d+:\d+: profile: there is no file 'chambers/mine\.yaml'"):
        load_bench(path)


def test_a_step_is_refused_where_the_controller_ramps_by_itself(tmp_path: Path) -> None:
    path = bench_with(tmp_path, TEXT, "{profile: chambers/mine.yaml, step: 20 s}")
    with pytest.raises(InputError, match=r"bench\.yaml:\d+:\d+: step: this controller ramps by itself"):
        load_bench(path)


def test_a_kept_bench_file_outlives_its_profile(tmp_path: Path) -> None:
    path = bench_with(tmp_path, TEXT)
    (tmp_path / "chambers/mine.yaml").unlink()
    options = load_kept_bench(path).devices["chamber"].options
    assert isinstance(options, ModbusChamberOptions)
    assert options.profile.content is None


REFUSED_BY_BOTH = [
    {"address": 70000}, {"address": "12"}, {"address": 1, "type": "int8"}, {"address": 1, "read": 6},
    {"address": 1, "scale": 0}, {"addres": 1}, {},
]  # fmt: skip


@pytest.mark.parametrize("register", REFUSED_BY_BOTH)
def test_what_the_loader_refuses_in_a_register_the_schema_refuses(tmp_path: Path, register: dict[str, Any]) -> None:
    value = dict(read_document(SHIPPED).value, process_value=register)
    assert list(Draft202012Validator(chamber_profile_schema()).iter_errors(value))
    with pytest.raises(ValueError, match="process_value"):
        ChamberProfile.model_validate(value)


def test_the_schema_that_is_shipped_is_the_one_of_the_program() -> None:
    shipped = json.loads((ROOT / "docs/schema/chamber-profile.schema.json").read_text("utf-8"))
    assert shipped == chamber_profile_schema()


def test_a_run_on_a_described_controller_passes_and_keeps_the_profile(tmp_path: Path, bench_here: Any) -> None:
    bench = bench_with(tmp_path / "config", TEXT)
    smoke = ["run", "smoke", "--bench", bench, "--runs", tmp_path / "runs", "--uut", "QF-0001"]
    done = bench_here(*smoke)
    assert (done.returncode, "Verdict: PASS" in done.stdout) == (0, True), done.stdout + done.stderr
    (run,) = (tmp_path / "runs").iterdir()
    assert (run / "mine.yaml").read_text("utf-8") == TEXT
