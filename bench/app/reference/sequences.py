"""Reference pages on sequence files: steps, other keys, and settings of each installed method."""

from __future__ import annotations

import inspect
from collections.abc import Collection, Iterable
from importlib.resources import files
from pathlib import Path

from bench.app.reference.keys import Blocks, keys, part, table
from bench.sequence.document.model import SequenceFile
from bench.sequence.language.expressions import Value, evaluate
from bench.sequence.language.values import in_words
from bench.sequence.method import CIRCUIT_OUTPUT, GYRO_OUTPUT, OUTPUT, MethodDescription, known_methods
from bench.sequence.steps.custom import Custom, known_steps
from bench.sequence.steps.verbs import BLOCKS, NEEDS, STEPS
from drivers.quantity.quantities import parse
from drivers.schema.fields import keys_of

EXAMPLES = Path(str(files("bench.app.reference"))) / "every_step.yaml"
UNITS = {
    "time": "s min h d day",
    "temperature, and a difference of temperatures": "°C degC",
    "angle": "° deg arcmin arcsec rad turn",
    "rate": "°/s rpm",
    "acceleration; g is local gravity": "g m/s²",
    "electricity": "A V W Ω ohm",
    "counts, codes of an A/D converter, and frequency": "pulse code LSB Hz",
    "length and mass": "m kg",
    "force and pressure": "N Pa hPa",
    "ratio": "% ppm 1",
}
OUTPUT_IS = (
    " `output` is `pulse/s`, `V` where a voltmeter measures the unit, or `code` where the unit sends its output and "
    "the bench file names no other unit."
)
GYRO_OUTPUT_IS = " `gyro_output` is the same of its gyros; of pulses, pulse/s/(°/s) is `pulse/°`."
CIRCUIT_OUTPUT_IS = " `circuit_output` is the unit of the reading of its temperature circuit."
# examples of expressions, evaluated for the page, with explanations
EXPRESSIONS = (
    ("temperature + '5 °C'", "`+` `-` `*` `/`, a name, and a constant, which stands in quotes"),
    ("2 * (soak - '10 min')", "parentheses"),
    ("temperature >= '20 °C'", "`<` `<=` `>` `>=` `==` `!=`"),
    ("temperature > '0 °C' and not soak == '1 h'", "`and` `or` `not`"),
    ("'2 h' if temperature < '0 °C' else '1 h'", "one value or another"),
    ("abs(temperature - '30 °C')", "the size, without the sign"),
    ("positions + '10°'", "a list, with each of its values"),
    ("min(soak, '90 s')", "the smallest of values or of a list"),
    ("max(positions)", "the largest of values or of a list"),
    ("round(2.6)", "the nearest whole number; for numbers without a unit"),
    ("sqrt('9 m²/s²')", "square root"),
    ("sin('30°')", "sine of an angle"),
    ("cos('60°')", "cosine of an angle"),
    ("len(positions)", "how many values a list has"),
)
NAMES: dict[str, Value] = {
    "temperature": parse("25 °C"),
    "soak": parse("1 h"),
    "positions": tuple(map(parse, ("0°", "90°", "180°"))),
}


def sequence_page() -> Blocks:
    """Keys of a sequence file except its steps, and notation of values."""
    return [
        "# Sequence files",
        "A file in `sequences/`: the steps of a test, and its results. `bench new sequence NAME` "
        "writes [one to start from](../../bench/sequence/document/starter.yaml), "
        "`bench check FILE` reports every problem. "
        "For the contents of `setup`, `steps` and `teardown`, see [steps](steps.md).",
        "NAME is chosen by you. A key with an empty default is optional.",
        *keys(SequenceFile, 2),
        "## Values",
        "* A *quantity* is a number and its unit: `20 °C`, `1 h 30 min`, `1.5 °/s`, `54°44'08\"`, `200 µg/°C`. Any "
        "unit of the same kind will do where a key asks for one.\n"
        "* A *name* has at most 32 small letters, digits and `_`, a letter first.\n"
        "* A *list* is `[0°, 90°, 180°]`. A *range* `{from: 20 °C, to: 70 °C, step: 10 °C}` holds both its ends.\n"
        "  The values of `{from: 1 Hz, to: 100 Hz, per_decade: 12}` have a constant ratio.\n"
        "* A *value* is a quantity, a number, a text, `true` or `false`.",
        table(("of", "units"), ((what, f"`{'` `'.join(units.split())}`") for what, units in UNITS.items())),
        "Units may be multiplied (`·`), divided (`/`) and raised (`m/s²`). `n` `µ` `m` `k` `M` go before `s` `m` `A` "
        "`V` `W` `Ω` `Hz` `g` `rad` `arcsec` `pulse` `N` `Pa`.",
        "## Expressions",
        "A value may be `${…}` over parameters, the names of loops around the step, and what was measured or answered "
        f"before; in `settings` of results, over parameters. Here {_names()}.",
        table(("expression", "gives", "shows"), map(_evaluated, EXPRESSIONS)),
    ]


def _names() -> str:
    return ", ".join(f"`{name}` is `{_written(value)}`" for name, value in NAMES.items())


def _evaluated(example: tuple[str, str]) -> tuple[str, str, str]:
    expression, shows = example
    return f"`${{{expression}}}`", f"`{_written(evaluate(expression, NAMES))}`", shows


def _written(value: Value) -> str:
    return f"[{', '.join(map(in_words, value))}]" if isinstance(value, tuple) else in_words(value)


def methods_page() -> Blocks:
    """Methods with their results, settings and limits."""
    methods = known_methods()
    return [
        "# Methods",
        "Methods available in the `results` of a [sequence file](sequence.md), including installed plug-ins.",
        *(block for name in sorted(methods) for block in _method(methods[name])),
    ]


def _method(method: MethodDescription) -> Blocks:
    measured_output = any(OUTPUT in unit for unit in method.stated.values())
    return [
        f"## {method.name}",
        f"{method.title}.",
        *part(method.settings, "settings", 3),
        *_parts(method),
        "### `limits`",
        "Each key is one of these results; its limits are in the unit, or one that goes with it."
        + (OUTPUT_IS if measured_output else "")
        + (GYRO_OUTPUT_IS if any(GYRO_OUTPUT in unit for unit in method.stated.values()) else "")
        + (CIRCUIT_OUTPUT_IS if CIRCUIT_OUTPUT in method.stated.values() else ""),
        table(("result", "unit"), ((f"`{name}`", unit) for name, unit in method.stated.items())),
    ]


def _parts(method: MethodDescription) -> Blocks:
    """Return the section on loops and groups that a method identifies by name."""
    if not method.parts:
        return []
    rows = ((f"`{each.name}`", each.kind, each.meaning, each.without) for each in method.parts)
    return [
        "### Names of loops and groups",
        "The reduction knows acquisitions of `data` by these names of the loops and groups around them.",
        table(("name", "of a", "meaning", "without it"), rows),
    ]


def steps_page() -> Blocks:
    """Steps with their effect, object, example and keys."""
    blocks = [verb for verb in BLOCKS if verb not in STEPS]
    common = set.intersection(*(set(keys_of(model)) for model in STEPS.values()))
    any_step = next(iter(STEPS.values()))
    return [
        "# Steps",
        "Contents of the lists `setup`, `steps` and `teardown` of a [sequence file](sequence.md). The first key of "
        "a step is its verb; its object is named as in `needs`. A value may be an "
        "[expression](sequence.md#expressions) `${…}`. A key with an empty default is optional.",
        table(("", ""), (("steps", _links(STEPS)), ("steps with steps inside", _links(blocks)))),
        "## Keys of every step",
        *keys(any_step, 3, without=set(keys_of(any_step)) - common),
        *(block for verb in (*STEPS, *blocks) for block in _step(verb, common)),
    ]


def _links(verbs: Iterable[str]) -> str:
    return " · ".join(f"[{verb}](#{verb})" for verb in verbs)


def _step(verb: str, common: Collection[str]) -> Blocks:
    model, kinds, found = BLOCKS[verb], NEEDS.get(verb, ()), examples().get(verb)
    return [
        f"## {verb}",
        inspect.getdoc(model) or "",
        *([f"Acts on: {' or '.join(f'`{kind}`' for kind in kinds)}."] if kinds else []),
        *([f"```yaml\n{found}\n```"] if found else []),
        *keys(model, 3, without=common if verb in STEPS else ()),
        *(_plug_ins() if model is Custom else ()),
    ]


def _plug_ins() -> Blocks:
    """Return the section on the steps of installed plug-ins, with their settings."""
    blocks = []
    for name, step in sorted(known_steps().items()):
        acts_on = f" Its role is a `{step.capability}`." if step.capability else ""
        blocks += [f"### custom: {name}", f"{step.title}.{acts_on}", *part(step.settings, "with", 4)]
    return blocks


def examples() -> dict[str, str]:
    """Return examples of steps by verb, taken from one valid sequence."""
    _, _, steps = EXAMPLES.read_text("utf-8").partition("\nsteps:\n  - ")
    found: dict[str, list[str]] = {}
    for step in steps.rstrip("\n").split("\n  - "):
        found.setdefault(step.partition(":")[0], []).append("- " + step.replace("\n  ", "\n"))
    return {verb: "\n".join(of_verb) for verb, of_verb in found.items()}
