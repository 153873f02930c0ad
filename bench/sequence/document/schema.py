"""The JSON Schema of sequence files; see bench.config.schema for what a schema can express."""

from __future__ import annotations

from typing import Any

from bench.config.interlocks import INTERLOCKS
from bench.config.schema import Schema, object_of, schema_of, when, without_unused
from bench.sequence.document.model import ResultEntry, SequenceFile
from bench.sequence.language.values import VALUE_SCHEMA
from bench.sequence.method import known_methods
from bench.sequence.steps.verbs import BLOCKS
from drivers.schema.fields import EXPRESSION, UNIT_KEYWORD

_WORDS = {"description", "default"}  # for parts whose value the schema does not describe
_STEP = {"$ref": "#/$defs/AnyBlock"}


def sequence_schema() -> Schema:
    """Schema of sequence files, with the settings and results of every installed method."""
    methods = known_methods()
    schema, refs = schema_of(
        SequenceFile, [ResultEntry, *BLOCKS.values(), *(method.settings for method in methods.values())]
    )
    result = schema["$defs"][ResultEntry.__name__]
    result["properties"]["method"] = {"enum": sorted(methods)}
    result["allOf"] = []
    for name, method in sorted(methods.items()):
        settings = {"settings": method.settings}
        names = {"propertyNames": {"enum": list(method.quantities)}}
        limits = {"limits": names, "monthly_drift": names}
        then = object_of({"settings": refs[method.settings], **limits}, settings)
        result["allOf"].append(when("method", name, then))
        _allow_expressions(schema["$defs"][method.settings.__name__]["properties"])
    for model in BLOCKS.values():
        properties = schema["$defs"][model.__name__]["properties"]
        properties.update({key: VALUE_SCHEMA | found for key, found in properties.items() if not found.keys() - _WORDS})
    interlocks = {model.__name__ for model in INTERLOCKS.values()}  # contain neither expressions nor steps
    _complete([part for name, part in schema["$defs"].items() if name not in interlocks])
    schema["$defs"]["AnyBlock"] = {
        "description": "A step or a loop; its first key is its verb.",
        "oneOf": [refs[model] for model in BLOCKS.values()],
    }
    return without_unused(schema)


def _allow_expressions(properties: dict[str, Any]) -> None:
    """Allow an expression for every setting with a list of permitted texts, a number or a truth value."""
    for name, found in properties.items():
        if "enum" in found or found.get("type") in ("integer", "number", "boolean"):
            choice = {key: found.pop(key) for key in ("enum", "type", "minimum", "maximum") if key in found}
            properties[name] = {**found, "anyOf": [choice, {"type": "string", "pattern": EXPRESSION}]}


def _complete(node: Any) -> None:
    """Allow an expression for every quantity, and steps in every untyped list.

    Pydantic generates neither: the model of a step is chosen by its verb during validation.
    """
    if isinstance(node, list):
        for item in node:
            _complete(item)
    elif isinstance(node, dict):
        if UNIT_KEYWORD in node:
            node["description"] += ", or an expression ${…}"
        if node.get("items") == {}:
            node["items"] = _STEP
        for item in node.values():
            _complete(item)
