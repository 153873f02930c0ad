"""Strict YAML 1.2 documents: a small safe subset, with the place of every value.

Refused are files above 32 KiB, text that is not UTF-8, more than 4000 lines, anchors, aliases, tags, merge keys, second
documents, duplicate keys, nesting beyond 20 and more than 1500 values, all before anything is built. With these limits
the parser, written in Python, takes less than 100 ms for any file. Plain scalars are null, true, false, decimal
integers and decimal floats; everything else is text, so `on`, `010`, `1_000`, `1:30`, `.nan` and dates stay as written.
Invisible characters, and those that change the displayed order, are refused everywhere.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from yaml import MarkedYAMLError, YAMLError, events

from bench.errors import InputError
from drivers.schema.bounded import UnfitFileError, read_bounded
from drivers.schema.wording import value_text

SIZE_LIMIT_BYTES = 32 * 1024
LINE_LIMIT = 4000
DEPTH_LIMIT = 20
NODE_LIMIT = 1500
SCALAR_LIMIT = 4096
_INVISIBLE = "contains the invisible character U+{:04X}; remove it"
_ANCHORED = "anchors (&) and aliases (*) are not part of this language; repeat the value, or put text in quotes"
_TAGGED = "tags (!) are not part of this language; put text in quotes"
_DEEP = f"is nested more than {DEPTH_LIMIT} deep"

_INTEGER = re.compile(r"-?(0|[1-9]\d{0,18})", re.ASCII)
_FLOAT = re.compile(r"-?(0|[1-9]\d*)(\.\d+)?([eE][+-]?\d{1,3})?", re.ASCII)
_UNSEEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ud800-\udfff\ufeff"
    "\ufffe\uffff\U000e0000-\U000e007f]"
)
# detected before parsing, which would be slow:
_TOO_DEEP = re.compile(rf"(?:[\[{{][^][{{}}]{{0,100}}){{{DEPTH_LIMIT + 1}}}")
_CLOSED = re.compile(r"\[[^][{}]{0,100}\]|\{[^][{}]{0,100}\}")
_LONG_TAG = re.compile(r"^%TAG|(?<![^\s\[{,:-])!\S{100}", re.MULTILINE)
_FAST = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml, if PyYAML was built with it
_WORDS: dict[str, Any] = {"": None, "~": None, "null": None, "true": True, "false": False}

# messages of the parser for common mistakes, and their replacements
_PLAINLY = (
    ("character '\\t'", "a tab stands where only spaces may; indent with spaces"),
    ("mapping values are not allowed", "a colon stands where none may; put text with ': ' in it in quotes"),
    ("expected <block end>", "this line is not indented like those it belongs to"),
    ("could not find expected ':'", "a key needs a colon and a space after it"),
    ("cannot start any token", "text cannot begin with this character; put it in quotes"),
    ("expected alphabetic or numeric character", "text cannot begin with & or *; put it in quotes"),
    ("unknown escape character", "a backslash means something else in double quotes; put the text in single quotes"),
    ("found unexpected end of stream", "a quotation mark is not closed"),
    ("expected ',' or ']'", "a comma is missing here, or a bracket is not closed"),
    ("expected ',' or '}'", "a comma is missing here, or a brace is not closed"),
    ("expected the node content", "a value is expected here"),
    ("sequence entries are not allowed", "a list of lines that begin with - begins on a line of its own"),
    ("expected '<document start>'", "the document has ended before this"),
)
# errors that Python reports with its own message
_IMPOSSIBLE = "an escape that stands for no character, or a version far too long"
_LEFT_OPEN = ("could not find expected ':'", "unexpected end of stream", "<stream end>")

Place = tuple[str | int, ...]
Problem = tuple[Place, str]  # problem at a place of a document


class Mark(NamedTuple):
    """Position in a file; both numbers begin at 1."""

    line: int
    column: int


@dataclass(frozen=True)
class Document:
    """Value of a file (dict, list, str, int, float, bool, None), its text, and the position of each part.

    `included` are documents that replace a part of this one: places in them continue the place of that part.
    """

    path: Path
    text: str
    value: Any
    marks: dict[Place, Mark]
    included: dict[Place, Document] = field(default_factory=dict)

    def include(self, place: Place, other: Document) -> None:
        """Replace the part at `place` by another document."""
        owner, inner = self.owner(place)
        owner.included[inner] = other

    def all_included(self) -> list[Document]:
        """Return all documents included in this one, directly or indirectly; each file once."""
        found: dict[Path, Document] = {}
        for document in self.included.values():
            found[document.path] = document
            found.update((inner.path, inner) for inner in document.all_included())
        return list(found.values())

    def owner(self, place: Place) -> tuple[Document, Place]:
        """Return the document that contains a part, and its place there."""
        for length in range(1, len(place) if self.included else 0):
            if inner := self.included.get(place[:length]):
                return inner.owner(place[length:])
        return self, place

    def mark(self, place: Place) -> Mark:
        """Return the position of a part in the document that contains it, or of the nearest part around it."""
        owner, inner = self.owner(place)
        for length in range(len(inner), -1, -1):
            if mark := owner.marks.get(inner[:length]):
                return mark
        return Mark(1, 1)

    def where(self, place: Place) -> str:
        """Return `file:line:column` of a part, or of the nearest part around it."""
        mark = self.mark(place)
        return f"{self.owner(place)[0].path}:{mark.line}:{mark.column}"

    def located(self, problems: Iterable[Problem]) -> list[str]:
        """Return `file:line:column: problem` for each distinct problem, in the order of the files."""
        found = dict.fromkeys((self.owner(place)[0].path, self.mark(place), problem) for place, problem in problems)
        in_order = sorted(found, key=lambda item: (item[0] != self.path, *item))
        return [f"{path}:{mark.line}:{mark.column}: {problem}" for path, mark, problem in in_order]


def read_document(path: Path) -> Document:
    """Read and parse a file. Raises InputError with the place of the problem."""
    return parse_document(read_text(path), path)


def read_text(path: Path) -> str:
    """Read the text of a file. Raises InputError if it is missing, too long or not UTF-8."""
    try:
        return read_bounded(path, SIZE_LIMIT_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        line = problem.object.count(b"\n", 0, problem.start) + 1
        raise InputError(f"{path}:{line}:1: is not UTF-8 text; save it as UTF-8") from None
    except UnfitFileError as problem:
        raise InputError(f"{path}: {problem}") from None


def parse_document(text: str, path: Path) -> Document:
    """Parse `text`; `path` is only used in messages."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n")
    opened = _CLOSED.sub(lambda pair: " " * len(pair[0]), lines)  # only open brackets are left
    for bad, where, problem in (
        (_UNSEEN, lines, _INVISIBLE), (_LONG_TAG, lines, _TAGGED), (_TOO_DEEP, lines, _DEEP), (_TOO_DEEP, opened, _DEEP)
    ):  # fmt: skip
        if found := bad.search(where):
            line = lines.count("\n", 0, found.start()) + 1
            column = found.start() - lines.rfind("\n", 0, found.start())
            raise InputError(f"{path}:{line}:{column}: {problem.format(ord(found[0][0]))}")
    if lines.count("\n") > LINE_LIMIT:
        raise InputError(f"{path}:{LINE_LIMIT + 1}:1: has more than {LINE_LIMIT} lines")
    builder = _Builder(path)
    try:
        value = builder.build(yaml.parse(lines, Loader=_FAST))
    except YAMLError:  # the parser written in Python has better messages and positions
        builder = _Builder(path)
        value = _parsed_in_python(lines, builder, path)
    return Document(path, text, value, builder.marks)


def _parsed_in_python(lines: str, builder: _Builder, path: Path) -> Any:
    """Return the value from the parser written in Python. Raises InputError."""
    try:
        return builder.build(yaml.parse(lines, Loader=yaml.SafeLoader))
    except MarkedYAMLError as error:
        raise InputError(f"{path}:{_plain_message(error)}") from None
    except (YAMLError, ValueError, OverflowError) as error:
        mark = max(builder.marks.values(), default=Mark(1, 1))
        message = str(error).splitlines()[0] if isinstance(error, YAMLError) else _IMPOSSIBLE
        problem = f"what follows here is not YAML: {message}"
        raise InputError(f"{path}:{mark.line}:{mark.column}: {problem}") from None


def _plain_message(error: MarkedYAMLError) -> str:
    """Return position and message of a parser error in plain terms; for an unclosed bracket its beginning."""
    message = str(error.problem or error.context)
    marks = (error.problem_mark, error.context_mark)
    if any(part in message for part in _LEFT_OPEN):
        marks = marks[::-1]
    mark = marks[0] or marks[1]
    at = f"{mark.line + 1}:{mark.column + 1}" if mark is not None else "1:1"
    return f"{at}: is not YAML: {next((words for part, words in _PLAINLY if part in message), message)}"


class _Builder:
    """Builder of values from parser events, without recursion."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._nodes = 0
        self.marks: dict[Place, Mark] = {}

    def build(self, stream: Iterator[Any]) -> Any:
        documents = 0
        root: Any = None
        open_nodes: list[_Node] = []
        for event in stream:
            if isinstance(event, events.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    self._refuse(event, "a second document begins; one file holds one")
            elif isinstance(event, (events.MappingEndEvent, events.SequenceEndEvent)):
                open_nodes.pop()
            elif isinstance(event, events.NodeEvent):
                value = self._node(event, open_nodes)
                if not open_nodes:
                    root = value
                    self.marks.setdefault((), _mark(event))
                else:
                    open_nodes[-1].add(value, event, self)
                if isinstance(value, (dict, list)):
                    open_nodes.append(_Node(value, open_nodes[-1].place_of_last if open_nodes else ()))
        return root

    def _node(self, event: Any, open_nodes: list[_Node]) -> Any:
        """Return the value that an event begins, after checking all limits."""
        self._nodes += 1
        if self._nodes > NODE_LIMIT:
            self._refuse(event, f"has more than {NODE_LIMIT} values")
        if isinstance(event, events.AliasEvent) or event.anchor:
            self._refuse(event, _ANCHORED)
        if event.tag:
            self._refuse(event, _TAGGED)
        if isinstance(event, events.ScalarEvent):
            return self._scalar(event)
        if len(open_nodes) >= DEPTH_LIMIT:
            self._refuse(event, _DEEP)
        return {} if isinstance(event, events.MappingStartEvent) else []

    def _scalar(self, event: Any) -> Any:
        text = event.value
        if len(text) > SCALAR_LIMIT:
            self._refuse(event, f"is longer than {SCALAR_LIMIT} characters")
        if found := _UNSEEN.search(text):
            self._refuse(event, _INVISIBLE.format(ord(found[0])))
        if event.style:
            return text
        if text in _WORDS:
            return _WORDS[text]
        if _INTEGER.fullmatch(text):
            return int(text)
        if not _FLOAT.fullmatch(text):
            return text
        if not math.isfinite(number := float(text)):
            self._refuse(event, f"{text} is not a finite number")
        return number

    def _refuse(self, event: Any, problem: str) -> None:
        mark = _mark(event)
        raise InputError(f"{self._path}:{mark.line}:{mark.column}: {problem}")

    def add_key(self, key: Any, event: Any, node: _Node) -> None:
        """Check a key; a duplicate is refused with both positions."""
        if not isinstance(key, str):
            if isinstance(key, (list, dict)):
                self._refuse(event, f"a key is text, found a {'list' if isinstance(key, list) else 'mapping'}")
            self._refuse(event, f"a key is text, found {value_text(key)}; put it in quotes")
        if key == "<<":
            self._refuse(event, "merge keys (<<) are not part of this language; repeat the values")
        if key in node.value:
            before = self.marks[(*node.place, key)]
            self._refuse(event, f"the key '{key}' stands twice; it is already in line {before.line}")


class _Node:
    """Mapping or list under construction."""

    def __init__(self, value: Any, place: Place) -> None:
        self.value, self.place = value, place
        self._key: str | None = None
        self.place_of_last = place

    def add(self, value: Any, event: Any, builder: _Builder) -> None:
        """Add the next key, value or item."""
        if isinstance(self.value, list):
            self.place_of_last = (*self.place, len(self.value))
            self.value.append(value)
            builder.marks[self.place_of_last] = _mark(event)
        elif self._key is None:
            builder.add_key(value, event, self)
            self._key = str(value)
            self.place_of_last = (*self.place, self._key)
            builder.marks[self.place_of_last] = _mark(event)
        else:
            self.value[self._key] = value
            self._key = None


def _mark(event: Any) -> Mark:
    return Mark(event.start_mark.line + 1, event.start_mark.column + 1)
