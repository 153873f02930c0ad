"""YAML that somebody is typing: what stands at the cursor, and where in the document, as far as it can be read."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import yaml

from bench.config.document import DEPTH_LIMIT, Place

HERE = "itbcursor"  # stands for the word at the cursor while the text is read
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_WORD = re.compile(r"[A-Za-z_][\w/]*$")


class Spot(NamedTuple):
    """Place of a cursor: the word before it begins at `start`; `place` is that of a key, or of a value.

    `document` is what could be read, without the word.
    """

    start: int
    place: Place
    is_key: bool
    document: Any


def spot_at(text: str, at: int) -> Spot | None:
    """Return the place of a cursor, given as the number of letters before it; None if it is in no readable place."""
    before = text[:at]
    found = _WORD.search(before)
    start = found.start() if found else at
    before, after = text[:start], re.sub(r"^[\w/]*", "", text[at:])
    is_written = after.startswith(":")  # the rest of a key
    for word in (HERE,) if is_written else (f"{HERE}: 0", HERE):
        document, place, is_key = _read(before + word + after)
        if place is not None:
            return Spot(start, place, is_key, document)
    return None


def as_read(text: str) -> Any:
    """Return a document as far as it can be read."""
    return _read(text)[0]


class _Reader:
    """Builds a document from events, until they end or fail."""

    def __init__(self) -> None:
        self.document: Any = None
        self.place: Place | None = None
        self.is_key = False
        self._open: list[tuple[Any, Place]] = []
        self._keys: list[str | None] = []

    def take(self, event: yaml.Event) -> bool:
        """Add an event; return False if no more is wanted."""
        if isinstance(event, yaml.MappingStartEvent | yaml.SequenceStartEvent):
            node: Any = {} if isinstance(event, yaml.MappingStartEvent) else []
            place = self._add(node)
            self._open.append((node, place))
            self._keys.append(None)
            return len(self._open) <= DEPTH_LIMIT
        if isinstance(event, yaml.MappingEndEvent | yaml.SequenceEndEvent):
            self._open.pop()
            self._keys.pop()
        elif isinstance(event, yaml.ScalarEvent):
            self._add(event.value)
        elif isinstance(event, yaml.AliasEvent):
            self._add("")
        return True

    def _add(self, node: Any) -> Place:
        """Add a key, a value or an item to what is open; return its place."""
        if not self._open:
            self.document = node
            if node == HERE:
                self.place = ()
            return ()
        holder, place = self._open[-1]
        if isinstance(holder, list):
            place = (*place, len(holder))
            holder.append(node)
        elif self._keys[-1] is None:
            self._keys[-1] = node if isinstance(node, str) else ""
            if node == HERE:
                self.place, self.is_key = place, True
            return place
        else:
            key, self._keys[-1] = self._keys[-1], None
            place = (*place, key)
            if key != HERE:
                holder[key] = node
        if node == HERE:
            self.place = place
        return place


def _read(text: str) -> tuple[Any, Place | None, bool]:
    reader = _Reader()
    try:
        for event in yaml.parse(text, Loader=_LOADER):
            if not reader.take(event):
                break
    except (yaml.YAMLError, ValueError):  # what was read before counts
        pass
    return reader.document, reader.place, reader.is_key
