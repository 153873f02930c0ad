"""The DBC that was kept with a run, for the frames in it."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

from bench.errors import StoreError
from drivers.can.dbc import Dbc, DbcError
from drivers.can.options import text_of
from drivers.schema.bounded import UnfitFileError

FormatT = TypeVar("FormatT")


def kept_format(path: Path, bind: Callable[[Dbc], FormatT]) -> FormatT:
    """What `bind` makes of the DBC in a file; StoreError when that cannot be read, or is another."""
    try:
        return bind(_parsed(text_of(path)))
    except (UnfitFileError, DbcError) as problem:
        raise StoreError(f"{path}: the frames of this run cannot be decoded ({problem})") from problem


@lru_cache(maxsize=8)  # of the few counters of a run, for each of its labels
def _parsed(text: str) -> Dbc:
    return Dbc(text)
