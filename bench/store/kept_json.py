"""Strict reading of the JSON files of a run: size, values and structure."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.errors import StoreError
from drivers.schema.bounded import read_bounded

LIMIT_BYTES = 64 * 2**20
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")  # unpaired surrogates; this program never writes them

Form = Callable[[object], str]
"""Validator: return the problem of a value, with its place in the document first, or "" if it is valid."""


def read_kept(path: Path, form: Form, limit_bytes: int = LIMIT_BYTES) -> Any:
    """Read a JSON file and validate it. Raises StoreError with the problem."""
    try:
        text = read_bounded(path, limit_bytes).decode("utf-8")
        if _SURROGATE.search(text):
            raise ValueError("an unpaired surrogate")
        content = json.loads(text, parse_constant=_refused, parse_float=_finite)
    except (ValueError, RecursionError) as problem:
        raise StoreError(f"{path}: cannot be read ({problem})") from problem
    if wrong := form(content):
        raise StoreError(f"{path}: {wrong.strip()}")
    return content


def a(kind: type | tuple[type, ...], in_words: str) -> Form:
    """Return the form of a value of a type; booleans are not accepted as numbers."""

    def form(value: object) -> str:
        fits = isinstance(value, kind) and (not isinstance(value, bool) or kind is bool)
        return "" if fits else f" is not {in_words}"

    return form


def one_of(*known: str) -> Form:
    """Return the form of one of the given words."""
    return lambda value: "" if value in known and isinstance(value, str) else f" is not {' or '.join(known)}"


def nullable(form: Form) -> Form:
    """Return the form of a value or null."""
    return lambda value: "" if value is None else form(value)


def list_of(form: Form) -> Form:
    """Return the form of a list of such values."""

    def of_list(value: object) -> str:
        if not isinstance(value, Sequence) or isinstance(value, str):
            return " is not a list"
        return next((f".{index}{wrong}" for index, each in enumerate(value) if (wrong := form(each))), "")

    return of_list


def pair(form: Form) -> Form:
    """Return the form of a pair of such values."""
    return lambda value: (
        list_of(form)(value) or ("" if isinstance(value, list) and len(value) == 2 else " is not a pair")
    )


def named(form: Form) -> Form:
    """Return the form of an object with any names and such values."""

    def of_names(value: object) -> str:
        if not isinstance(value, Mapping):
            return " is not an object"
        return next((f".{name}{wrong}" for name, each in value.items() if (wrong := form(each))), "")

    return of_names


def object_of(forms: Mapping[str, Form], required: Sequence[str] = ()) -> Form:
    """Return the form of an object with these fields; other fields are ignored."""

    def of_object(value: object) -> str:
        if not isinstance(value, Mapping):
            return " is not an object"
        if missing := [name for name in required if name not in value]:
            return f" has no '{missing[0]}'"
        return next(
            (f".{name}{wrong}" for name, form in forms.items() if name in value and (wrong := form(value[name]))), ""
        )

    return of_object


TEXT, WHOLE, NUMBER = a(str, "text"), a(int, "a whole number"), a((int, float), "a number")
TRUTH = a(bool, "true or false")


def _refused(word: str) -> float:
    raise ValueError(f"{word} is not a number")


def _finite(text: str) -> float:
    if not math.isfinite(value := float(text)):
        raise ValueError(f"{text} is not a number")
    return value
