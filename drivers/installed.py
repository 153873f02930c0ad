"""Lookup of objects by name: those shipped with the program, and entry points of installed packages.

Each is imported on first use. Packages are searched only for names that the program does not ship, because that search
takes longer than many checks.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from functools import cached_property, lru_cache
from importlib import import_module
from typing import Any, Generic, TypeVar

OfferedT = TypeVar("OfferedT")


@lru_cache(maxsize=1)
def _points(_path: tuple[str, ...]) -> Any:
    """All entry points on a search path, cached: even for a single group Python reads the files of all packages."""
    from importlib.metadata import entry_points

    return entry_points()


def loaded(target: str) -> Any:
    """Import the object named by "module:attribute"."""
    module, _, attribute = target.partition(":")
    return getattr(import_module(module.strip()), attribute.strip())


class Installed(Mapping[str, OfferedT], Generic[OfferedT]):
    """Objects of an entry point group by name; a plug-in cannot take the name of a shipped one.

    `shipped` maps names to "module:attribute".
    """

    def __init__(self, group: str, shipped: Mapping[str, str]) -> None:
        self._group = group
        self._shipped = shipped
        self._loaded: dict[str, OfferedT] = {}

    @cached_property
    def _offered(self) -> Mapping[str, str]:
        points = _points(tuple(sys.path)).select(group=self._group)
        return {point.name: point.value for point in points if point.name not in self._shipped}

    def __getitem__(self, name: str) -> OfferedT:
        if name not in self._loaded:
            self._loaded[name] = loaded(self._shipped.get(name) or self._offered[name])
        return self._loaded[name]

    def __contains__(self, name: object) -> bool:
        return name in self._shipped or name in self._offered

    def __iter__(self) -> Iterator[str]:
        yield from sorted([*self._shipped, *self._offered])

    def __len__(self) -> int:
        return len(self._shipped) + len(self._offered)
