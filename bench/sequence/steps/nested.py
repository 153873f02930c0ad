"""Steps inside steps: the model of a step is chosen by its first key during validation.

The models by verb are in the context of the validation, under MODELS: they hold steps themselves, and so import this.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BaseModel, PlainValidator, ValidationInfo, ValidatorFunctionWrapHandler, WrapValidator

from drivers.quantity.units import quoted
from drivers.schema.fields import NOT_EMPTY
from drivers.schema.suggest import did_you_mean
from drivers.schema.wording import expected, telling

MODELS = "models"  # key in the context of a validation
UNROLLED = object()  # stands for inner steps that are validated already


def block_model(raw: object, models: Mapping[str, type[BaseModel]]) -> type[BaseModel]:
    """Return the model of a step by its first key, its verb; PydanticCustomError if there is no such verb."""
    if not isinstance(raw, dict) or not raw:
        raise expected("a step: a mapping whose first key is its verb", raw)
    verb = str(next(iter(raw)))
    if verb in models:
        return models[verb]
    if later := [key for key in raw if key in models]:
        raise telling(f"the first key of a step is its verb: put '{later[0]}' before {quoted(verb)}")
    raise telling(f"unknown step {quoted(verb)}{did_you_mean(verb, models)}")


def _block(raw: object, info: ValidationInfo) -> BaseModel:
    context: Any = info.context
    return block_model(raw, context[MODELS]).model_validate(raw, context=context)


def _inside(raw: object, handler: ValidatorFunctionWrapHandler) -> Any:
    return () if raw is UNROLLED else handler(raw)


AnyBlock = Annotated[Any, PlainValidator(_block)]
Steps = Annotated[tuple[AnyBlock, ...], NOT_EMPTY, WrapValidator(_inside)]
