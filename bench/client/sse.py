"""Server-sent events: parsing of a stream."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

LINE_LIMIT_BYTES = 2**22


class ServerEvent(NamedTuple):
    """Event of a stream: its identifier, kind and data."""

    id: str
    kind: str
    data: str


def server_events(lines: Iterable[bytes]) -> Iterator[ServerEvent]:
    """Yield the complete events of a stream of lines; comments and an event without its end are left out."""
    fields: dict[str, str] = {}
    for line in lines:
        if not line.endswith(b"\n"):
            return  # cut off
        text = line.rstrip(b"\r\n").decode(errors="replace")
        if text:
            name, _, value = text.partition(":")
            value = value.removeprefix(" ")
            fields[name] = f"{fields['data']}\n{value}" if name == "data" and "data" in fields else value
            continue
        if "data" in fields:
            yield ServerEvent(fields.get("id", ""), fields.get("event", ""), fields["data"])
        fields = {}
