"""Pydantic's errors in plain text: the value found, and the expected one."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError

from drivers.quantity.units import quoted

# Expected values, by pydantic's error type; placeholders are its context.
_EXPECTED: Mapping[str, str] = {
    "string_type": "text",
    "string_too_short": "text",
    "string_too_long": "at most {max_length} characters",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_parsing_size": "a whole number with fewer digits",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "literal_error": "{expected}",
    "enum": "{expected}",
    "greater_than": "more than {gt:.12g}",
    "greater_than_equal": "at least {ge:.12g}",
    "less_than": "less than {lt:.12g}",
    "less_than_equal": "at most {le:.12g}",
    "dict_type": "a mapping",
    "mapping_type": "a mapping",
    "model_type": "a mapping",
    "tuple_type": "a list",
    "list_type": "a list",
}


def telling(problem: str) -> PydanticCustomError:
    """Error with exactly this message, to be raised by a validator."""
    return PydanticCustomError("told", "{problem}", {"problem": problem})


def problem_at(place: tuple[str | int, ...], problem: str) -> InitErrorDetails:
    """Error of a part, to be raised among others by a validator of the whole."""
    return InitErrorDetails(type=telling(problem), loc=place, input=None)


def expected(what: str, found: object) -> PydanticCustomError:
    """Error for an unexpected value, to be raised by a validator."""
    return telling(f"is {value_text(found)}, expected {what}")


def error_text(error: ErrorDetails) -> str:
    """Plain text of one of pydantic's errors."""
    kind, known = error["type"], error.get("ctx", {})
    if kind == "missing":
        return "is missing"
    if kind == "value_error":
        return str(known["error"])
    if kind not in _EXPECTED:
        return error["msg"]
    unquoted = kind == "string_type" and isinstance(error["input"], (bool, int, float))
    what = _EXPECTED[kind].format_map(known)
    return f"is {value_text(error['input'])}, expected {what}{'; put it in quotes' if unquoted else ''}"


def value_text(value: object) -> str:
    """Format a value of a document for a message: `'text'`, `5`, `true`, "a list", "a mapping", "empty"."""
    if value is None or value == "":
        return "empty"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)):
        return str(value)
    if isinstance(value, (list, tuple)):
        return "a list" if value else "empty"
    if isinstance(value, Mapping):
        return "a mapping" if value else "empty"
    return quoted(value)
