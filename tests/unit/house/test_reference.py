"""The reference pages: current, whole, and true; every key says what it means."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Annotated, Literal

import pytest
from pydantic import Field

from bench.app.reference import benches, sequences
from bench.app.reference.keys import keys, part, table
from bench.cli import reference
from bench.cli.reference import PAGES
from bench.cli.table import ALL
from bench.config.models import BenchFile
from bench.errors import InputError
from bench.sequence.language import expressions
from bench.sequence.steps.custom import StepDescription
from bench.sequence.steps.verbs import BLOCKS
from drivers.description import DriverDescription, known_drivers
from drivers.quantity import units
from drivers.schema.fields import Celsius, Flag, InUnit, Name, Seconds, StrictModel, WholeNumber
from tests.support.runs import ROOT
from tests.support.sequences import load_plan

FOLDER = ROOT / "docs/reference"
page_text = partial(reference.page_text, commands=ALL)
write_pages = partial(reference.write_pages, commands=ALL)
AGAIN = "the models have changed; write the pages again with: bench reference --out docs/reference"

# Keys whose meaning only their model's sentence, their type and the example tell. May shrink, must not grow.
UNEXPLAINED: dict[str, str] = {}


def models(base: type[StrictModel] = StrictModel) -> Iterator[type[StrictModel]]:
    for model in base.__subclasses__():
        yield model
        yield from models(model)


def unexplained() -> dict[str, set[str]]:
    """By module, keys of our models that have no description, no mention in the docstring, and no part that has one."""
    assert known_drivers()
    assert BenchFile.model_fields
    cases = re.compile(r"bench\.offline\.case.*|bench\.methods\.\w+\.offline")  # which have no page
    all_models = [model for model in models() if not cases.fullmatch(model.__module__)]
    verbs = {(model, verb) for verb, model in BLOCKS.items()}  # told by the docstring
    found: dict[str, set[str]] = {}
    for model in all_models:
        for name in model.model_fields.keys() & model.__annotations__.keys():
            field = model.model_fields[name]
            key = field.alias or name
            is_part = any(part.__name__ in repr(field.annotation) for part in all_models)
            is_told = field.description or f"`{key}`" in (model.__doc__ or "") or (model, key) in verbs
            if model.__module__.startswith(("bench.", "drivers.")) and not (is_part or is_told):
                found.setdefault(model.__module__, set()).add(f"{model.__name__}.{key}")
    return found


@pytest.mark.parametrize("name", PAGES)
def test_the_page_in_docs_is_current(name):
    assert (FOLDER / f"{name}.md").read_text("utf-8") == page_text(name), AGAIN


def test_there_is_no_page_that_nothing_makes():
    assert {path.stem for path in FOLDER.iterdir()} == set(PAGES)


def test_every_key_says_what_it_means_but_those_listed_here():
    listed = {module: set(keys_.split()) for module, keys_ in UNEXPLAINED.items()}
    assert unexplained() == listed, "describe the key, or name it in its model's docstring; take it off when it is told"


@pytest.mark.parametrize("name", PAGES)
def test_every_row_of_a_table_has_as_many_cells_as_its_head(name):
    tables = [block.splitlines() for block in page_text(name).split("\n\n") if block.startswith("|")]
    assert tables
    for rows in tables:
        assert len({len(re.split(r"(?<!\\)\|", row)) for row in rows}) == 1, rows[0]


def test_every_link_leads_somewhere():
    links = [(name, target) for name in PAGES for target in re.findall(r"\]\(([^)]*)\)", page_text(name))]
    assert links
    for name, target in links:
        path, _, anchor = target.partition("#")
        assert not path or (FOLDER / path).resolve().is_file(), f"{name}: {target}"
        if anchor:
            heads = re.findall(r"^#+ (.*)$", page_text(path.removesuffix(".md") or name), re.MULTILINE)
            assert anchor in [head.lower().replace(" ", "-") for head in heads], f"{name}: {target}"


# What the pages hold that no model tells


def test_there_is_an_example_of_every_step_but_those_of_plug_ins():
    assert set(sequences.examples()) == set(BLOCKS) - {"custom"}


@pytest.mark.parametrize("name", ["every_step.yaml", "warm_up.yaml"])
def test_the_sequence_of_all_examples_is_right(name):
    assert len(load_plan(sequences.EXAMPLES.with_name(name), None)) > 0


def test_an_example_is_as_it_stands_in_the_sequence_two_columns_to_the_left():
    assert sequences.examples()["if"] == (
        "- if: ${case_temperature > '30 °C'}\n  then:\n    - wait: 10 min\n  else:\n    - wait: 1 min"
    )


def test_every_function_of_expressions_is_shown():
    shown = " ".join(expression for expression, _ in sequences.EXPRESSIONS)
    assert [name for name in expressions._FUNCTIONS if f"{name}(" not in shown] == []


def test_every_unit_is_listed_and_known():
    listed = " ".join(sequences.UNITS.values()).split()
    assert {*units._PLAIN, *units._PREFIXABLE} <= set(listed)
    assert all(units.parse_unit(unit) for unit in listed)


def test_every_command_is_told():
    page = page_text("commands")
    assert "## bench run\n" in page
    assert "## bench runs verify\n" in page
    assert "| `SEQUENCE` | required |" in page
    assert "| `--bench FILE` |  | The bench file; default: $BENCH_FILE, or the shipped simulated bench. |" in page
    assert "| `--strict` |  |" in page
    assert r"| `--format text\|json\|sarif\|github` | `text` |" in page


def test_a_fresh_process_tells_every_command_that_a_module_has():
    program = "import bench.cli.reference as r, bench.cli.table as t; print(r.page_text('commands', t.ALL), end='')"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=True)
    trees = [ast.parse(path.read_text("utf-8")) for path in (ROOT / "bench/cli").glob("*.py")]
    calls = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Call)]
    commands = [ast.literal_eval(call.args[0]) for call in calls if getattr(call.func, "id", "") == "Command"]
    assert len(commands) > 30
    assert sorted(re.findall(r"^## bench (.*)$", done.stdout, re.MULTILINE)) == sorted(commands)


# How a model is told


class Inner(StrictModel):
    """What is inside; with a second sentence.

    And a paragraph.
    """

    low: Celsius = Field(description="the lower end")


class Other(StrictModel):
    """Another kind."""

    high: Celsius


class Bare(StrictModel):
    on: Flag


class Settings(StrictModel):
    """All kinds of keys."""

    name: Name
    hold: Seconds = Field(90.0, description="how long")
    ratio: Annotated[float, InUnit("", above=0, at_most=5)] = 0.5
    way: Literal["up", "down"] = Field("up", description="which way")
    count: Annotated[WholeNumber, Field(ge=1, lt=9)] = 3
    net: Flag = False
    word: str | None = None
    temperatures: tuple[Celsius, ...] = ()
    inner: Inner | None = None
    parts: Mapping[str, Inner | Other] = {}
    bare: Bare | None = None


def test_a_table_tells_of_each_key_its_meaning_its_values_and_its_default():
    first, *_ = keys(Settings, 2, without={"word"})
    assert first == "\n".join(
        [
            "| key | default | value |",
            "| --- | --- | --- |",
            "| `name` | required | a name |",
            "| `hold` | `90 s` | how long; a quantity in s, at least 0 s |",
            "| `ratio` | `0.5` | a number without a unit, more than 0, at most 5 |",
            "| `way` | `up` | which way; `up` or `down` |",
            "| `count` | `3` | a whole number, at least 1, less than 9 |",
            "| `net` | `false` | `true` or `false` |",
            "| `temperatures` |  | a list, each: a quantity in °C |",
            "| `inner` |  | what is inside; with a second sentence |",
            "| `parts` |  | by name: one of the kinds below |",
            "| `bare` |  | a value |",
        ]
    )


def test_parts_follow_with_their_paths_and_alternatives_with_the_key_that_tells_them_apart():
    blocks = part(Settings, "options", 3)
    assert blocks[:2] == ["### `options`", "All kinds of keys."]
    assert [block for block in blocks if block.startswith("####")] == [
        "#### `options.inner`",
        "#### `options.parts.NAME: low`",
        "#### `options.parts.NAME: high`",
        "#### `options.bare`",
    ]
    assert blocks[4] == "What is inside; with a second sentence.\n\nAnd a paragraph."
    assert blocks[-1].splitlines()[-1] == "| `on` | required | `true` or `false` |"


def test_a_bar_in_a_cell_does_not_end_it():
    assert table(["a"], [["b|c"]]).splitlines()[-1] == r"| b\|c |"


def test_a_driver_of_a_plug_in_is_told(monkeypatch):
    def channels(_options: Settings) -> dict[str, str]:
        """One reading for each of its sensors."""
        return {}

    mine = DriverDescription(
        "mine", "my oven", frozenset({"thermal_chamber"}), frozenset({"serial"}), "mine:Oven", options=Settings,
        channels=channels,
    )  # fmt: skip
    monkeypatch.setattr(benches, "known_drivers", lambda: {"mine": mine})
    page = "\n\n".join(benches.drivers_page())
    assert "| [`mine`](#mine) | my oven |" in page
    assert "## mine\n\nMy oven.\n" in page
    assert "| readings | One reading for each of its sensors. |" in page
    assert "#### `options.inner`" in page
    assert "### `limits`" not in page


def test_a_step_of_a_plug_in_is_told(monkeypatch):
    mine = StepDescription("knock", "Knocks on the door", "mine:knock", Settings, capability="thermal_chamber")
    monkeypatch.setattr(sequences, "known_steps", lambda: {"knock": mine})
    page = "\n\n".join(sequences.steps_page())
    assert "### custom: knock\n\nKnocks on the door. Its role is a `thermal_chamber`.\n\n#### `with`" in page


# Writing


def test_all_pages_are_written_and_named(tmp_path):
    paths = write_pages(tmp_path / "made/here")
    assert [path.stem for path in paths] == [*PAGES]
    assert (tmp_path / "made/here/rules.md").read_text("utf-8") == page_text("rules")


def test_pages_that_cannot_be_written_are_told(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"file/README.md: cannot be written"):
        write_pages(tmp_path / "file")


def test_a_page_that_does_not_exist_is_told_with_the_one_that_is_meant():
    with pytest.raises(InputError, match="there is no page 'stps'; did you mean 'steps'"):
        page_text("stps")
