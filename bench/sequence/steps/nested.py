"""Steps inside steps: which model a step has is chosen by its first key, while it is validated."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, PlainValidator, ValidationInfo, ValidatorFunctionWrapHandler, WrapValidator

from drivers.schema.fields import NOT_EMPTY

UNROLLED = object()  # stands for the steps inside a step that were looked at already


def _block(raw: object, info: ValidationInfo) -> BaseModel:
    from bench.sequence.steps.verbs import block_model  # which knows every step, those that hold steps among them

    return block_model(raw).model_validate(raw, context=info.context)


def _inside(raw: object, handler: ValidatorFunctionWrapHandler) -> Any:
    return () if raw is UNROLLED else handler(raw)


AnyBlock = Annotated[Any, PlainValidator(_block)]
Steps = Annotated[tuple[AnyBlock, ...], NOT_EMPTY, WrapValidator(_inside)]
