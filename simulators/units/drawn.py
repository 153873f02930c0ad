"""Constants of a unit as drawn for one run; each states its place in the file of the unit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar, get_type_hints

from pydantic import BaseModel

from simulators.units.unit_file import Draw, stream

TruthT = TypeVar("TruthT")


@dataclass(frozen=True, slots=True)
class At:
    """Keys of a constant in the model of a unit, such as `converter.alpha`."""

    keys: str


def drawn(truth: Callable[..., TruthT], model: BaseModel, seed: int, *path: str, **given: Any) -> TruthT:
    """Draw the constants that are annotated with a place, every `{mean, sd}` from its own stream below `path`.

    The others are `given`, or keep their defaults, as do those in a part that the model does not have.
    """
    found: dict[str, Any] = {}
    for name, keys in _places(truth).items():
        part: Any = model
        for key in keys[:-1]:
            part = getattr(part, key)
            if part is None:
                break
        else:
            found[name] = _value(getattr(part, keys[-1]), seed, (*path, *keys))
    return truth(**found, **given)


def _value(stated: Any, seed: int, path: tuple[str, ...]) -> Any:
    """A number drawn, the numbers of all fields of a model, or what needs no drawing."""
    if isinstance(stated, BaseModel):
        return tuple(_value(each, seed, (*path, name)) for name, each in stated)
    return stated.value(stream(seed, "uut", *path)) if isinstance(stated, Draw) else stated


@cache
def _places(truth: Callable[..., object]) -> Mapping[str, list[str]]:
    hints = get_type_hints(truth, include_extras=True)
    at = {name: each for name, hint in hints.items() for each in getattr(hint, "__metadata__", ())}
    return {name: each.keys.split(".") for name, each in at.items() if isinstance(each, At)}
