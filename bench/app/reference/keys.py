"""Tables of keys from the models of documents: meaning, notation and default of each key."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from typing import get_args

from pydantic import BaseModel

from bench.config.schema import Schema, schema_of
from drivers.schema.fields import UNIT_KEYWORD, Name

Blocks = list[str]  # of Markdown: headings, paragraphs, tables

_DEEPEST = 4  # heading level
_NOTHING = {"type": "null"}
_NAME_IN_FULL: str = get_args(Name)[1].what
_PLAIN = {"boolean": "`true` or `false`", "string": "a text", "integer": "a whole number", "number": "a number"}
_BOUNDS = {
    "minimum": "at least",
    "exclusiveMinimum": "more than",
    "maximum": "at most",
    "exclusiveMaximum": "less than",
}


def part(model: type[BaseModel], path: str, level: int) -> Blocks:
    """Return the section on the part at `path` of a document: heading, description, keys, parts; empty without keys.

    Args:
        model: of that part of the document.
        path: keys from the top of the document or of a step, with points between them.
        level: of the heading.
    """
    schema, _ = schema_of(model, ())
    return _part(schema["$defs"], schema, path, level)


def keys(model: type[BaseModel], level: int, without: Collection[str] = ()) -> Blocks:
    """Return the table of a model's keys except `without`, then its parts with headings of this level."""
    schema, _ = schema_of(model, ())
    return _keys(schema["$defs"], schema, "", level, without)


def table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table in Markdown."""
    heads = list(heads)
    lines = (heads, ["---"] * len(heads), *([cell.replace("|", "\\|") for cell in row] for row in rows))
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _part(known: Schema, ref: Schema, path: str, level: int) -> Blocks:
    found = _definition(known, ref)
    if not found.get("properties"):
        return []
    said = [found["description"]] if "description" in found else []
    return [f"{'#' * level} `{path}`", *said, *_keys(known, ref, path, min(level + 1, _DEEPEST))]


def _keys(known: Schema, ref: Schema, path: str, level: int, without: Collection[str] = ()) -> Blocks:
    found = _definition(known, ref)
    nodes = {key: node for key, node in found["properties"].items() if key not in without}
    required = found.get("required", ())
    rows = [(f"`{key}`", _default(node, key in required), _value(known, node)) for key, node in nodes.items()]
    blocks = [table(("key", "default", "value"), rows)] if rows else []
    for key, node in nodes.items():
        for inner, place in _inside(known, node, f"{path}.{key}" if path else key):
            blocks += _part(known, inner, place, level)
    return blocks


def _definition(known: Schema, ref: Schema) -> Schema:
    """Return the target of a reference; for a part with a short form, the full form."""
    found: Schema = known[ref["$ref"].removeprefix("#/$defs/")]
    return next((kind for kind in found.get("anyOf", ()) if "properties" in kind), found)


def _default(node: Schema, is_required: bool) -> str:
    """Return the default of a key as written in a document."""
    if is_required:
        return "required"
    default = node.get("default", "")
    return f"`{str(default).lower() if isinstance(default, bool) else default}`" if default != "" else ""


def _inside(known: Schema, node: Schema, path: str) -> Iterator[tuple[Schema, str]]:
    """Yield the parts in the value of a key with their paths; alternatives with their distinguishing key."""
    if "$ref" in node:
        yield node, path
    kinds = [kind for kind in node.get("anyOf", ()) if "$ref" in kind]
    keys_of_kinds = [list(_definition(known, kind).get("properties", ())) for kind in kinds]
    for kind, own in zip(kinds, keys_of_kinds, strict=True):
        only = [key for key in own if sum(key in other for other in keys_of_kinds) == 1]
        yield kind, f"{path}: {only[0]}" if len(kinds) > 1 and only else path
    for item in _items(node):
        yield from _inside(known, item, path)
    if named := _of_each_name(node):
        yield from _inside(known, named, f"{path}.NAME")


def _items(node: Schema) -> list[Schema]:
    """Return the schemas of list items; empty for a list of steps, whose models are documented elsewhere."""
    return node.get("prefixItems") or [found for found in [node.get("items")] if found]


def _of_each_name(node: Schema) -> Schema:
    """Return the schema of the values of a mapping by name."""
    named = [*node.get("patternProperties", {}).values(), node.get("additionalProperties")]
    return next((found for found in named if isinstance(found, dict)), {})


def _value(known: Schema, node: Schema) -> str:
    """Return the meaning of a key and the notation of its value."""
    said = str(node.get("description", "")).replace(_NAME_IN_FULL, "a name")
    if UNIT_KEYWORD in node:
        return said.replace(f", like {node['examples'][0]}", "")
    if said and _has_notation(node):
        return said
    return "; ".join(filter(None, (said, _kind(known, node)))) or "a value"


def _has_notation(node: Schema) -> bool:
    """Return True if the description of a value includes its notation."""
    if "anyOf" in node:
        return _NOTHING not in node["anyOf"]
    return not node.keys() & {"enum", "const"} and (node.get("type") == "string" or isinstance(node.get("type"), list))


def _kind(known: Schema, node: Schema) -> str:
    """Return the notation of a value, by its type."""
    match node:
        case {"$ref": _}:
            summary = str(_definition(known, node).get("description", "")).partition("\n")[0].rstrip(".")
            return summary[:1].lower() + summary[1:]
        case {"enum": choices}:
            return " or ".join(f"`{choice}`" for choice in choices)
        case {"const": only}:
            return f"`{only}`"
        case {"anyOf": [{"$ref": _}, {"$ref": _}, *_]}:
            return "one of the kinds below"
        case {"anyOf": kinds}:
            return " or ".join(dict.fromkeys(_value(known, kind) for kind in kinds if kind != _NOTHING))
        case {"type": "array"}:
            items = _items(node)
            return f"a list, each: {_value(known, items[0])}" if items else "a list of steps"
        case {"type": "object"}:
            return f"by name: {_value(known, _of_each_name(node))}"
        case {"type": [*kinds]}:
            return "a quantity" if "number" in kinds else "a text"
        case {"type": str(plain)}:
            bounds = (f", {words} {node[bound]}" for bound, words in _BOUNDS.items() if bound in node)
            return _PLAIN[plain] + "".join(bounds)
    return ""
