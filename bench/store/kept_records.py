"""Reading the records of a kind, of all users and of this one: any of them may be nonsense, or go away meanwhile."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from bench.errors import StoreError
from bench.store.kept_json import Form, read_kept
from bench.store.machine_state import printable, records


def kept_records(
    kind: str, form: Form, unusable: str, unreadable: Callable[[StoreError], object]
) -> Iterator[tuple[Path, Any]]:
    """Every record of a kind that has the form, with its file; why another one cannot be read goes to `unreadable`.

    One that was removed meanwhile is passed over. Raises StoreError, which begins with `unusable`, where they cannot be
    listed; and whatever `unreadable` raises.
    """
    try:
        paths = list(records(kind))
    except OSError as problem:
        raise StoreError(f"{unusable} ({problem})") from problem
    for path in paths:
        try:
            content = read_kept(path, form)
        except StoreError as problem:
            if os.path.lexists(path):
                unreadable(StoreError(printable(str(problem))))
        else:
            yield path, content
