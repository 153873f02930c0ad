"""What installed packages offer under a group of entry points, by name; each is imported when it is asked for."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar

OfferedT = TypeVar("OfferedT")


@lru_cache(maxsize=1)
def _points(_path: tuple[str, ...]) -> Any:
    """Every entry point on a search path: for a single group Python reads the files of all packages as well."""
    return entry_points()


class Installed(Mapping[str, OfferedT], Generic[OfferedT]):
    """The entry points of a group by name; an item is imported when it is asked for, not with the others."""

    def __init__(self, group: str) -> None:
        offered = _points(tuple(sys.path)).select(group=group)
        self._points: dict[str, EntryPoint] = {point.name: point for point in offered}
        self._loaded: dict[str, OfferedT] = {}

    def __getitem__(self, name: str) -> OfferedT:
        if name not in self._loaded:
            self._loaded[name] = self._points[name].load()
        return self._loaded[name]

    def __contains__(self, name: object) -> bool:
        return name in self._points

    def __iter__(self) -> Iterator[str]:
        return iter(self._points)

    def __len__(self) -> int:
        return len(self._points)
