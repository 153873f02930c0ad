"""JSON Schemas (draft 2020-12) of documents, generated from their models, for completion and checks in editors.

A schema covers keys, types and names. It does not cover relations (a range that rises, a signal in the DBC, the first
key of a step): those are checked by `bench check`. Descriptions give the meaning of a key and the notation of its
value; defaults are written as in a document. The reference pages are generated from these schemas as well.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue, models_json_schema
from pydantic_core import core_schema

from bench.config.models import BenchFile
from bench.config.scenario import ScenarioFile
from drivers.description import DriverDescription, known_drivers
from drivers.schema.fields import UNIT_KEYWORD, ModelBeside

Schema = dict[str, Any]
DIALECT = "https://json-schema.org/draft/2020-12/schema"


def bench_schema() -> Schema:
    """Return the schema of bench files, with the blocks of every installed driver."""
    drivers = known_drivers()
    blocks = [model for driver in drivers.values() for model in _blocks(driver).values()]
    schema, refs = schema_of(BenchFile, blocks)
    device = schema["$defs"]["DeviceEntry"]
    device["properties"]["driver"] = {"enum": sorted(drivers)}
    device["allOf"] = [when("driver", name, _as_driver(drivers[name], refs)) for name in sorted(drivers)]
    return without_unused(schema)


def chamber_profile_schema() -> Schema:
    """Return the schema of the files that describe the controller of a chamber."""
    return _schema_of_file_beside("modbus_chamber")


def table_profile_schema() -> Schema:
    """Return the schema of the files that describe the frames of a table or a head."""
    return _schema_of_file_beside("framed_table")


def _schema_of_file_beside(driver: str) -> Schema:
    """Return the schema of the file that the options of a driver refer to."""
    return schema_of(model_beside(driver), ())[0]


def model_beside(driver: str) -> type[BaseModel]:
    """Return the model of the file that the options of a driver refer to."""
    fields = known_drivers()[driver].options.model_fields.values()
    (model,) = (each.model for field in fields for each in field.metadata if isinstance(each, ModelBeside))
    return model


def scenario_schema() -> Schema:
    """Return the schema of fault scripts for simulated instruments."""
    return schema_of(ScenarioFile, ())[0]


def schema_of(
    document: type[BaseModel], parts: Iterable[type[BaseModel]]
) -> tuple[Schema, Mapping[type[BaseModel], Schema]]:
    """Return the schema of a document, and references to the schemas of `parts` in it."""
    models = list(dict.fromkeys((document, *parts)))
    found, definitions = models_json_schema(
        [(model, "validation") for model in models], schema_generator=_DocumentSchema
    )
    refs = {model: dict(found[model, "validation"]) for model in models}
    return {"$schema": DIALECT, **refs[document], **definitions}, refs


def without_unused(schema: Schema) -> Schema:
    """Remove definitions without references; pydantic leaves those that a field has replaced."""
    text = json.dumps(schema)
    used = {name: found for name, found in schema["$defs"].items() if f'"#/$defs/{name}"' in text}
    return {**schema, "$defs": used}


def when(key: str, value: str, then: Schema) -> Schema:
    """Return a schema in which `then` applies if `key` has this value."""
    return {"if": {"properties": {key: {"const": value}}, "required": [key]}, "then": then}


def object_of(properties: Mapping[str, Schema], models: Mapping[str, type[BaseModel]]) -> Schema:
    """Return the schema of a mapping; keys are required if their models have required keys."""
    required = [
        key for key, model in models.items() if any(field.is_required() for field in model.model_fields.values())
    ]
    return {"properties": dict(properties), **({"required": required} if required else {})}


def _blocks(driver: DriverDescription) -> Mapping[str, type[BaseModel]]:
    return {
        "options": driver.options, "limits": driver.limits, "safe": driver.safe,
        "U": driver.uncertainty, "corrections": driver.corrections,
    }  # fmt: skip


def _as_driver(driver: DriverDescription, refs: Mapping[type[BaseModel], Schema]) -> Schema:
    """Return the schema of an entry of this driver beyond the common entry."""
    own = dict(_blocks(driver))
    certified = {name: own.pop(name) for name in ("U", "corrections")}
    schemes = "|".join(sorted(driver.schemes))
    return object_of(
        {
            "connection": {"pattern": rf"^(sim\+)?({schemes}):"},
            **{name: refs[model] for name, model in own.items()},
            "calibration": object_of({name: refs[model] for name, model in certified.items()}, certified),
        },
        own,
    )


class _DocumentSchema(GenerateJsonSchema):
    """Schema generator without titles that repeat the key; objects are closed where keys are names."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        """Return False."""
        return False

    def generate_inner(self, schema: Any) -> JsonSchemaValue:
        """Return the schema of a field; its description gives the meaning, then the notation of the value."""
        found = super().generate_inner(schema)
        if schema["type"] == "model-field":
            how = self.generate_inner(schema["schema"]).get("description")
            if how and how != found["description"]:
                return {**found, "description": f"{found['description']}; {how}"}
        return found

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        """Return the schema of the field with its default, if a document can express it."""
        found = self.generate_inner(schema["schema"])
        default = schema.get("default")
        if unit := found.get(UNIT_KEYWORD):
            return {**found, "default": f"{default:.12g} {unit}"}
        return {**found, "default": default} if isinstance(default, (str, int, float)) else found

    def dict_schema(self, schema: core_schema.DictSchema) -> JsonSchemaValue:
        """Return the schema of a mapping; keys that are not names are refused."""
        found = super().dict_schema(schema)
        return {**found, "additionalProperties": False} if "patternProperties" in found else found
