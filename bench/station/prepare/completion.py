"""Completion of a sequence that somebody types: keys, values and names that its schema and its bench allow there."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from bench.config.bench import load_bench
from bench.config.document import Place
from bench.errors import InputError
from bench.sequence.document.schema import sequence_schema
from bench.sequence.steps.verbs import BLOCKS, NEEDS
from bench.station.prepare.unfinished import HERE, as_read, spot_at
from drivers.capabilities import READING, THERMOMETER

Schema = Mapping[str, Any]
_BLOCK = "#/$defs/AnyBlock"
_EXPRESSION = re.compile(r"\$\{[^}\n]*?([a-z_][a-z0-9_]*)?$")
_LOOP = re.compile(r"\bfor_each:\s*([a-z][a-z0-9_]*)")
_LABEL = re.compile(r"\blabel:\s*([a-z][a-z0-9_]*)")


class Option(BaseModel):
    """Word that may stand at a cursor."""

    model_config = ConfigDict(frozen=True)

    label: str
    kind: str = Field(description="key, value or name")
    info: str = ""


class Completion(BaseModel):
    """Words that may stand at a cursor instead of the one that begins at `start`."""

    start: int = Field(description="number of letters before it")
    options: list[Option]


def complete(text: str, at: int, bench: Path | None) -> Completion:
    """Return what may stand at a cursor, given as the number of letters before it; for worker processes."""
    if (found := _EXPRESSION.search(text[:at])) is not None:
        start = found.start(1) if found[1] else at
        return Completion(start=start, options=list(_names(text)))
    spot = spot_at(text, at)
    if spot is None:
        return Completion(start=at, options=[])
    devices = _devices(bench)
    if spot.is_key:
        present = _part(spot.document, spot.place)
        options = list(_keys(spot.document, spot.place, present if isinstance(present, dict) else {}, devices))
    else:
        options = [*_special(text, spot.document, spot.place, devices), *_values(spot.document, spot.place)]
    first = {each.label: each for each in reversed(options)}
    return Completion(start=spot.start, options=list(reversed(first.values())))


def _names(text: str) -> Iterator[Option]:
    """Yield the names that expressions may use: parameters and variables of loops."""
    document = as_read(text)
    parameters = document.get("parameters") if isinstance(document, dict) else None
    if isinstance(parameters, dict):
        for name, entry in parameters.items():
            yield Option(label=name, kind="name", info=str(entry.get("help", "")) if isinstance(entry, dict) else "")
    for name in dict.fromkeys(_LOOP.findall(text)):
        yield Option(label=name, kind="name", info="loop")


def _keys(document: Any, place: Place, present: Mapping[str, Any], devices: Mapping[str, str]) -> Iterator[Option]:
    if place == ("needs",):
        yield from (
            Option(label=role, kind="key", info=kinds) for role, kinds in devices.items() if role not in present
        )
        return
    nodes = list(_at(document, place))
    if any(_is_block(node) for node in nodes) and not present:
        yield from (Option(label=verb, kind="key", info=_first_line(model.__doc__)) for verb, model in BLOCKS.items())
        return
    for node in _expanded(nodes, present):
        names = node.get("propertyNames", {}).get("enum", ())
        yield from (Option(label=name, kind="key") for name in names if name not in present)
        for name, found in node.get("properties", {}).items():
            if name not in present and isinstance(found, dict):  # False for one that may not stand here
                yield Option(label=name, kind="key", info=_info(found))


def _values(document: Any, place: Place) -> Iterator[Option]:
    """Yield the words that an enumeration allows."""
    for node in _expanded(list(_at(document, place)), None):
        info = _first_line(node.get("description"))
        words = [*node.get("enum", ()), *([node["const"]] if "const" in node else [])]
        words += ["true", "false"] if node.get("type") == "boolean" else []
        yield from (Option(label=str(word), kind="value", info=info) for word in words if word is not None)


def _special(text: str, document: Any, place: Place, devices: Mapping[str, str]) -> Iterator[Option]:
    """Yield names that no schema has: roles for a verb, kinds of the devices of the bench, labels of acquisitions."""
    key = place[-1] if place else ""
    needs = document.get("needs") if isinstance(document, dict) else None
    if place[:1] == ("needs",) and len(place) == 2:
        yield from (
            Option(label=kind, kind="value", info="of this bench")
            for kind in devices.get(str(key), "").split(", ")
            if kind
        )
    elif key in NEEDS and isinstance(needs, dict):
        yield from (
            Option(label=role, kind="name", info=kind) for role, kind in needs.items() if kind in NEEDS[str(key)]
        )
    elif key in ("data", "closure") and place[:1] == ("results",):
        yield from (Option(label=label, kind="name") for label in dict.fromkeys(_LABEL.findall(text)))


def _devices(bench: Path | None) -> dict[str, str]:
    """Return the capabilities of each device of a bench, and its readings, by name; {} if it cannot be read."""
    if bench is None:
        return {}
    try:
        return dict(_devices_of(bench, bench.stat().st_mtime_ns))
    except (InputError, OSError):
        return {}


@lru_cache(maxsize=16)
def _devices_of(bench: Path, _: int) -> dict[str, str]:
    found = load_bench(bench).bench
    devices = {role: ", ".join(sorted(entry.description.capabilities)) for role, entry in found.devices.items()}
    return {**devices, **dict.fromkeys(found.readings, f"{THERMOMETER}, {READING}")}


@lru_cache(maxsize=1)
def _schema() -> Schema:
    return sequence_schema()


def _part(document: Any, place: Place) -> Any:
    for part in place:
        try:
            document = document[part]
        except (KeyError, IndexError, TypeError):
            return None
    return document


def _at(document: Any, place: Place) -> Iterable[Schema]:
    """Return the schemas of a place, by what stands around it."""
    nodes: list[Schema] = [_schema()]
    for depth, part in enumerate(place):
        nodes = [child for node in _expanded(nodes, _part(document, place[:depth])) for child in _children(node, part)]
    return nodes


def _children(node: Schema, part: str | int) -> Iterator[Schema]:
    if isinstance(part, int):
        yield from [node["items"]] if isinstance(node.get("items"), dict) else []
    elif part in node.get("properties", {}):
        yield node["properties"][part]
    else:
        yield from (found for pattern, found in node.get("patternProperties", {}).items() if re.search(pattern, part))
        if isinstance(node.get("additionalProperties"), dict):
            yield node["additionalProperties"]


def _expanded(nodes: Iterable[Schema], value: Any) -> Iterator[Schema]:
    """Yield schemas with all that they refer to; of alternatives those that have the keys of a mapping."""
    for node in map(_resolved, (each for each in nodes if isinstance(each, dict))):
        yield node
        yield from _expanded(node.get("allOf", ()), value)
        if "if" in node:
            yield from _expanded([node.get("then" if _meets(node["if"], value) else "else", {})], value)
        several = [*node.get("oneOf", ()), *node.get("anyOf", ())]
        keys = [key for key in value if key != HERE] if isinstance(value, dict) else []
        fitting = [each for each in several if _knows(each, keys)] or [
            each for each in several if _knows(each, keys[:1])
        ]
        yield from _expanded(fitting, value)


def _resolved(node: Schema) -> Schema:
    if "$ref" not in node:
        return node
    found: Schema = _schema()["$defs"][node["$ref"].rpartition("/")[2]]
    return {**found, **{key: each for key, each in node.items() if key != "$ref"}}


def _is_block(node: Schema) -> bool:
    return node.get("$ref") == _BLOCK


def _knows(node: Schema, keys: Iterable[str]) -> bool:
    return all(any(True for _ in _children(_resolved(node), key)) for key in keys)


def _meets(condition: Schema, value: Any) -> bool:
    """Return True if a mapping meets the condition of a schema: constants and types of its properties."""
    if not isinstance(value, dict):
        return False
    for name, wanted in condition.get("properties", {}).items():
        given = value.get(name)
        if ("const" in wanted and given != wanted["const"]) or (
            wanted.get("type") == "string" and not isinstance(given, str)
        ):
            return False
    return True


def _info(node: Schema) -> str:
    whole = _resolved(node)
    return _first_line(whole.get("description")) or next(
        (_first_line(_resolved(each).get("description")) for each in whole.get("anyOf", ())), ""
    )


def _first_line(text: str | None) -> str:
    return (text or "").strip().partition("\n")[0]
