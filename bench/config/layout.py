"""Formatter of YAML files: indent of two spaces, lists indented by two, no trailing spaces.

Only the indentation of lines changes; their content and comments stay as written. A text whose value would change is
refused.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Enum, auto
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml
from yaml import tokens

from bench.config.document import parse_document, read_text
from bench.errors import InputError

STEP = 2
_FLOW_OPENS = (tokens.FlowMappingStartToken, tokens.FlowSequenceStartToken)
_FLOW_CLOSES = (tokens.FlowMappingEndToken, tokens.FlowSequenceEndToken)
_DASHES = re.compile(r"^( *)((?:- +)+)(?=\S)")


def changes(paths: Iterable[Path]) -> dict[Path, str]:
    """Return the files whose layout differs, with the formatted text. Raises InputError for an invalid document."""
    found: dict[Path, str] = {}
    refused: list[str] = []
    for path in paths:
        try:
            text = formatted(read_text(path), path)
            if text.encode() != path.read_bytes():
                found[path] = text
        except InputError as problem:
            refused += problem.problems
    if refused:
        raise InputError(*refused)
    return found


def formatted(text: str, path: Path) -> str:
    """Format the text of a document. Raises InputError if it is invalid or cannot be formatted."""
    before = _ordered(text, path)
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    moved = _moved(lines, _survey(lines))
    result = "\n".join(moved).rstrip("\n") + "\n"
    try:
        same = _ordered(result, path) == before
    except InputError:
        same = False
    if not same:
        raise InputError(f"{path}: cannot be laid out without a change of what it says; put its texts on one line each")
    return result


def _ordered(text: str, path: Path) -> str:
    """Return the value of a document with the order of its keys, which determines the verb of a step."""
    return json.dumps(parse_document(text, path).value)


@dataclass
class _Survey:
    """Layout of the lines of a document, by line number from 0."""

    columns: dict[int, int]  # required column of lines that begin with a key, an item or a value
    inside: set[int]  # continuation lines of a value, which move with its first line
    verbatim: set[int]  # lines that end inside a text, whose trailing spaces may belong to it


class _Kind(Enum):
    MAPPING = auto()
    LIST = auto()
    FLAT_LIST = auto()  # a list at the column of its key, which YAML allows


def _survey(lines: list[str]) -> _Survey:
    survey = _Survey({}, set(), set())
    levels: list[_Kind] = []
    flow_depth = flow_line = 0
    for token in yaml.scan("\n".join(lines), Loader=yaml.SafeLoader):
        line = token.start_mark.line
        if not flow_depth:
            flow_line = line
            _follow(token, levels)
            if (column := _column(token, levels)) is not None:
                survey.columns.setdefault(line, column)
        flow_depth += isinstance(token, _FLOW_OPENS) - isinstance(token, _FLOW_CLOSES)
        if isinstance(token, _FLOW_CLOSES):
            survey.inside.update(range(flow_line + 1, line + 1))
        if isinstance(token, tokens.ScalarToken):
            last = token.end_mark.line - (token.end_mark.column == 0)
            survey.inside.update(range(line + 1, last + 1))
            is_block = token.style in ("|", ">")
            survey.verbatim.update(range(line + is_block, last + is_block))
    return survey


def _follow(token: Any, levels: list[_Kind]) -> None:
    """Update the open indentation levels before a token."""
    if isinstance(token, tokens.BlockEntryToken) and levels[-1] is _Kind.MAPPING:
        levels.append(_Kind.FLAT_LIST)
    elif isinstance(token, (tokens.KeyToken, tokens.BlockEndToken)) and levels[-1] is _Kind.FLAT_LIST:
        levels.pop()
    if isinstance(token, tokens.BlockEndToken):
        levels.pop()
    elif isinstance(token, tokens.BlockMappingStartToken):
        levels.append(_Kind.MAPPING)
    elif isinstance(token, tokens.BlockSequenceStartToken):
        levels.append(_Kind.LIST)


def _column(token: Any, levels: list[_Kind]) -> int | None:
    """Return the required column of a line that begins with this token; None if the next token decides."""
    if isinstance(token, (tokens.KeyToken, tokens.ValueToken, tokens.BlockEntryToken)):
        return STEP * (len(levels) - 1)
    return STEP * len(levels) if isinstance(token, (tokens.ScalarToken, *_FLOW_OPENS)) else None


def _moved(lines: list[str], survey: _Survey) -> Iterator[str]:
    """Yield the lines at their required columns.

    A comment moves with the next line if both have the same column, else with the last line before it in its column,
    and else by as much as the line before it.
    """
    column = {number: len(line) - len(line.lstrip(" ")) for number, line in enumerate(lines)}
    begins = [number for number in survey.columns if number not in survey.inside]
    following = dict(pairwise(begins))
    gone: dict[int, int] = {}  # new column by old column
    shift, next_one = 0, begins[0] if begins else None
    for number, line in enumerate(lines):
        kept = line if number in survey.verbatim else line.rstrip(" \t")
        if number in survey.inside:
            yield _shifted(kept, shift)
        elif number in survey.columns:
            shift = survey.columns[number] - column[number]
            gone[column[number]] = survey.columns[number]
            next_one = following.get(number)
            yield _shifted(_DASHES.sub(_one_space, kept), shift)
        elif kept.lstrip(" ").startswith("#"):
            now = column[number]
            goes = gone.get(now, now + shift)
            if next_one is not None and column[next_one] == now:
                goes = survey.columns[next_one]
            yield _shifted(kept, goes - now)
        else:
            yield kept


def _one_space(dashes: re.Match[str]) -> str:
    return dashes[1] + "- " * dashes[2].count("-")


def _shifted(line: str, by: int) -> str:
    """Return a line moved right by a number of columns, or left as far as it has spaces."""
    if by >= 0:
        return " " * by + line if line else line
    spaces = len(line) - len(line.lstrip(" "))
    return line[min(-by, spaces) :]
