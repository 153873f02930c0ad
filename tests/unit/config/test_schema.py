"""JSON Schemas: what the loader refuses in keys, types and names, they refuse; what it takes, they take."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from bench.config.bench import load_bench
from bench.config.document import parse_document, read_document
from bench.config.interlocks import INTERLOCKS
from bench.config.load import load
from bench.config.models import BenchFile
from bench.config.schema import bench_schema
from bench.errors import InputError
from bench.sequence.document.schema import sequence_schema
from bench.sequence.steps.verbs import BLOCKS
from drivers.quantity.quantities import parse
from drivers.schema.fields import UNIT_KEYWORD
from tests.support.sequences import load_plan

ROOT = Path(__file__).parents[3]
BENCH = load_bench(ROOT / "config/simulated.yaml").bench
SCHEMAS = {"sequence": sequence_schema(), "bench": bench_schema()}
SEQUENCE_TEXT = (ROOT / "sequences/tumble_static.yaml").read_text("utf-8")
BENCH_TEXT = (ROOT / "config/simulated.yaml").read_text("utf-8")
SHIPPED = {
    "sequence": [*sorted((ROOT / "sequences").glob("*.yaml")), ROOT / "bench/sequence/document/starter.yaml"],
    "bench": sorted((ROOT / "config").glob("*.yaml")),
}


def refusals(kind: str, value: Any) -> list[str]:
    return [f"{error.json_path}: {error.message}" for error in Draft202012Validator(SCHEMAS[kind]).iter_errors(value)]


def nodes(schema: Any) -> Iterator[dict[str, Any]]:
    """Every mapping in a schema."""
    if isinstance(schema, dict):
        yield schema
    for inner in schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ():
        yield from nodes(inner)


def changed(text: str, old: str, new: str) -> str:
    assert old in text, old
    return text.replace(old, new, 1)


def load_changed_sequence(folder: Path, text: str) -> Any:
    """The value of a sequence that is good on the shipped bench; InputError when it is not."""
    path = folder / "s.yaml"
    path.write_text(text, "utf-8")
    load_plan(path, BENCH)
    return read_document(path).value


def load_changed_bench(text: str) -> Any:
    document = parse_document(text, ROOT / "config/changed.yaml")
    load(document, BenchFile)
    return document.value


@pytest.mark.parametrize("kind", SCHEMAS)
def test_the_schema_in_docs_is_current(kind):
    kept = json.loads((ROOT / f"docs/schema/{kind}.schema.json").read_text("utf-8"))
    again = f"bench schema {kind} > docs/schema/{kind}.schema.json"
    assert kept == SCHEMAS[kind], f"the models have changed; write it again with: {again}"


@pytest.mark.parametrize("kind", SCHEMAS)
def test_a_schema_is_one_of_the_draft_that_it_names(kind):
    assert SCHEMAS[kind]["$schema"] == Draft202012Validator.META_SCHEMA["$id"]
    Draft202012Validator.check_schema(SCHEMAS[kind])


@pytest.mark.parametrize("kind", SCHEMAS)
def test_every_definition_is_used_and_every_reference_is_defined(kind):
    used = {node["$ref"] for node in nodes(SCHEMAS[kind]) if "$ref" in node}
    assert used == {f"#/$defs/{name}" for name in SCHEMAS[kind]["$defs"]}


@pytest.mark.parametrize(("kind", "path"), [(kind, path) for kind in SHIPPED for path in SHIPPED[kind]])
def test_shipped_files_are_valid_and_name_their_schema(kind, path):
    assert refusals(kind, read_document(path).value) == []
    first = path.read_text("utf-8").splitlines()[0]
    assert (path.parent / first.removeprefix("# yaml-language-server: $schema=")).samefile(
        ROOT / f"docs/schema/{kind}.schema.json"
    )


@pytest.mark.parametrize("kind", SCHEMAS)
def test_every_quantity_names_its_unit_with_an_example_in_it(kind):
    quantities = [node for node in nodes(SCHEMAS[kind]) if UNIT_KEYWORD in node]
    fixed = [node for model in INTERLOCKS.values() for node in nodes(SCHEMAS[kind]["$defs"][model.__name__])]
    assert len(quantities) > 10
    for node in quantities:
        parse(node["examples"][0]).to(node[UNIT_KEYWORD])
        assert node["examples"][0] in node["description"]
        assert ("${…}" in node["description"]) == (kind == "sequence" and node not in fixed)


@pytest.mark.parametrize("kind", SCHEMAS)
def test_every_default_is_spelled_as_a_document_would(kind):
    with_default = [node for node in nodes(SCHEMAS[kind]) if "default" in node and "type" in node]
    assert len(with_default) > 3
    for node in with_default:
        assert list(Draft202012Validator(node).iter_errors(node["default"])) == []
        if unit := node.get(UNIT_KEYWORD):
            parse(node["default"]).to(unit)


def test_a_description_says_what_a_key_means_and_how_its_value_is_written():
    monitor = SCHEMAS["bench"]["$defs"]["Monitor"]["properties"]
    assert monitor["devices"]["description"] == "of all other devices; a quantity in s, like 1 s, more than 0 s"
    assert monitor["devices"]["default"] == "10 s"


def test_every_verb_has_its_alternative_and_every_list_of_steps_holds_steps():
    steps = [SCHEMAS["sequence"]["$defs"][model.__name__] for model in BLOCKS.values()]
    assert [verb for verb, step in zip(BLOCKS, steps, strict=True) if verb not in step["required"]] == []
    assert len(SCHEMAS["sequence"]["$defs"]["AnyBlock"]["oneOf"]) == len(BLOCKS)
    assert [node for node in nodes(SCHEMAS["sequence"]) if node.get("items") == {}] == []


# What is refused

BAD_SEQUENCES = [
    ("schema: itb-sequence/1", "schema: itb-sequence/2"),
    ("schema: itb-sequence/1", "schema: itb-bench/1"),
    ("title: Static temperature tumble\n", ""),
    ("title: Static temperature tumble", "title: 5"),
    ("title: Static temperature tumble", "title:"),
    ("\nneeds:", "\nneed:"),
    ("chamber: thermal_chamber", "chamber: chamber"),
    ("chamber: thermal_chamber", "Chamber: thermal_chamber"),
    ("    help: counting time at one position\n", ""),
    ("default: 60 s", "defalt: 60 s"),
    ("default: 60 s", "default:"),
    ("max: 10\n", "max: [10]\n"),
    ("step: 10 °C}", "stp: 10 °C}"),
    ("{from: 20 °C, ", "{"),
    ("    help: five temperatures instead of twelve, nine dwells\n", ""),
    ("- wait: ${warm_up}", "- wiat: ${warm_up}"),
    ("- wait: ${warm_up}", "- wait: 5"),
    ("- wait: ${warm_up}", "- wait: true"),
    ("- wait: ${warm_up}", "- wait:"),
    ("- wait: ${warm_up}", "- wait"),
    ("- wait: ${warm_up}", "- {}"),
    ("- wait: ${warm_up}", "- {wait: 5 s, settle: 1 s}"),
    ("output: on", "output: true"),
    ("output: on", "output: yes"),
    ("        output: on\n", ""),
    ("- set: supply", "- set: Supply"),
    ("approach: from_below", "approach: from_left"),
    ("settle: 5 s", "setle: 5 s"),
    ("label: tumble", "label: [tumble]"),
    ("- acquire: output\n                for: ${gate}", "- acquire: output"),
    ("{band: 0.2 °C, slope", "{band: 0.2, slope"),
    (", hold: 10 min}", "}"),
    ("- for_each: cycle", "- for_each: 5"),
    ("    in:\n      from: 1\n      to: ${cycles}\n", ""),
    ("    in:\n      from: 1\n", "    in:\n      form: 1\n"),
    ("    in: ${positions}", "    in:"),
    ("- method: temperature_tumble", "- method: tumble"),
    ("data: tumble", "dat: tumble"),
    ("settings: {degree: 4}", "settings: {degre: 4}"),
    ("settings: {degree: 4}", "settings: {degree: 5}"),
    ("K0:      ", "K9:      "),
    ("{max: 200 µg}", "{}"),
    ("{max: 200 µg}", "{mx: 200 µg}"),
    ("\nteardown:", "\nteardwn:"),
]

BAD_BENCHES = [
    ("schema: itb-bench/1\n", ""),
    ("\nsite:", "\nsites:"),
    ("height: 420 m", "height: 420"),
    ("height: 420 m", "height: [420 m]"),
    ("origin: model", "origin: guess"),
    ("k: 2, origin", "k: 5, origin"),
    ("k: 2, origin", "k: '2', origin"),
    ("  chamber:\n    driver", "  Chamber:\n    driver"),
    ("driver: watlow_f4t", "driver: watlow_ft4"),
    ("    driver: watlow_f4t\n", ""),
    ("connection: sim+tcp://127.0.0.1:1502", "connection: sim+slcan:///dev/ttyS0"),
    ("connection: sim+tcp://127.0.0.1:1502", "connection: 1502"),
    ("unit_id: 1", "unit_id: 248"),
    ("unit_id: 1", "unitid: 1"),
    ("unit_id: 1", "block_reads: off"),
    ("{serial: SIM-F4T-01}", "{serial: 5.10}"),
    ("{serial: SIM-F4T-01}", "{seral: 5}"),
    ("      ramp_rate: {max: 3 °C/min}\n", ""),
    ("safe: {temperature: 25 °C}", "safe: 25 °C"),
    ("axis: X", "axis: X Y"),
    ("settle: {band: 1 arcsec, hold: 1 s}", "settle: {band: 1 arcsec}"),
    ("harmonics: [2 arcsec, ", "harmonics: [2, "),
    ("{zero: 10 arcsec", "{zro: 10 arcsec"),
    ("certificate: SIM-2026-0101, ", ""),
    ("due: 2030-12-31", "due: 31.12.2030"),
    ("dbc: if_counter.dbc", "dbc: [if_counter.dbc]"),
    ("{positive: AxisX.Positive, ", "{"),
    ("tick: Latch.Tick,", "tick: Latch,"),
    ("voltage: {max: 16 V}", "voltage: {max: 16}"),
    ("options: {range: 20 mA, compliance: 10 V}\n", "\n"),
    ("from: counter.Temperatures.Unit", "from: counter"),
    ("gain: 0.2 %", "gain: [0.2 %]"),
    ("at_90: up", "at_90: left"),
    ("    channel: x\n", ""),
    ("period: 1 s\n", "period: 1\n"),
    ("seed: 1\n", "seed: one\n"),
    ("seed: 1\n", "seed: -1\n"),
    ("units: {a: uut", "units: {A: uut"),
    ("seed: 1\n", "faults: [{device: head, kind: broken, at: 5 s}]\n"),
]


@pytest.mark.lengthy
@pytest.mark.parametrize(("old", "new"), BAD_SEQUENCES)
def test_a_sequence_that_is_refused_by_the_loader_is_refused_by_the_schema(tmp_path, old, new):
    text = changed(SEQUENCE_TEXT, old, new)
    with pytest.raises(InputError):
        load_changed_sequence(tmp_path, text)
    assert refusals("sequence", parse_document(text, tmp_path).value)


@pytest.mark.parametrize(("old", "new"), BAD_BENCHES)
def test_a_bench_that_is_refused_by_the_loader_is_refused_by_the_schema(tmp_path, old, new):
    text = changed(BENCH_TEXT, old, new)
    with pytest.raises(InputError):
        load_changed_bench(text)
    assert refusals("bench", parse_document(text, tmp_path).value)


@pytest.mark.parametrize("phase", ["setup", "steps", "teardown"])
def test_an_unknown_step_is_refused_in_every_phase_and_at_every_depth(phase):
    value: dict[str, Any] = dict(parse_document(SEQUENCE_TEXT, ROOT).value)
    for block in ({"jump": "head"}, {"for_each": "a", "in": [1], "steps": [{"jump": "head"}]}):
        assert refusals("sequence", {**value, phase: [block]})
    assert refusals("sequence", {**value, phase: [{"for_each": "a", "in": [1], "steps": [{"wait": "1 s"}]}]}) == []


# What is taken


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("- wait: ${warm_up}", "- wait: 1 h 30 min"),
        ("- wait: ${warm_up}", "- wait: ${2 * warm_up + '5 s'}"),
        ("default: 60 s", "default: '60 s'"),
        ("max: 10\n", "max: 10.5\n"),
        ("step: 10 °C}     # rising", "step: 5 °C}"),
        ("default: [0°, 90°, 180°, 270°, ", "default: [[0°, 90°], {from: 180°, to: 270°, step: 90°}, "),
        ("    in: ${positions}", "    in: [0°, {from: 90°, to: 180°, step: 45°}]"),
        ("settings: {degree: 4}", "settings: {}"),
        ("settings: {degree: 4}\n", "\n"),
        ("{max: 200 µg}", "{max: 0.0002 g}"),
        ("approach: from_below\n", "\n"),
        ("- wait: ${warm_up}", "- wait: 0 s"),
    ],
)
def test_a_sequence_that_is_taken_by_the_loader_is_taken_by_the_schema(tmp_path, old, new):
    assert refusals("sequence", load_changed_sequence(tmp_path, changed(SEQUENCE_TEXT, old, new))) == []


@pytest.mark.parametrize("path", sorted((ROOT / "tests/broken/good").glob("*.yaml")), ids=lambda path: path.stem)
def test_a_sequence_that_is_told_nothing_is_taken_by_the_schema(path):
    assert refusals("sequence", read_document(path).value) == []


def test_what_a_sequence_can_do_without_is_not_asked_for(tmp_path):
    text = "schema: itb-sequence/1\ntitle: Short\nneeds: {}\nsteps: [wait: 1 s]\n"
    assert refusals("sequence", load_changed_sequence(tmp_path, text)) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("    safe: {temperature: 25 °C}\n", ""),
        ("    options: {unit_id: 1, loop: 1, word_order: low_first}\n", ""),
        ("{serial: SIM-F4T-01}", "{serial: 510}"),
        ("    identity: {serial: SIM-F4T-01}\n", "    identity: {serial: null}\n"),
        ("connection: sim+tcp://127.0.0.1:5025", "connection: serial:///dev/ttyUSB0?baud=9600"),
        ("identity: {model: SIM-PSU, serial: SIM-PSU-01}", "calibration: null"),
        ("    stale_after: 5 s\n", ""),
        ("gain: 0.2 %", "gain: 0.002"),
        ("k: 2, origin", "k: 1.96, origin"),
        (", k: 2, U: {time_base: 1 ppm}", ""),
        ("monitor:\n  period: 1 s\n", ""),
        ("seed: 1\n", "faults: [{device: head, kind: silent, at: 5 min}]\n"),
        ("start: 2026-01-01T00:00:00Z", "start: 2026-01-01 08:00+08:00"),
        ("latitude: 34.25°", "latitude: 34°15'00\""),
    ],
)
def test_a_bench_that_is_taken_by_the_loader_is_taken_by_the_schema(old, new):
    assert refusals("bench", load_changed_bench(changed(BENCH_TEXT, old, new))) == []
