"""Reading of records of all users; any of them may be malformed, or disappear while it is read."""

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
    """Yield every valid record of a kind with its file; errors of the others are passed to `unreadable`.

    A record that was removed meanwhile is ignored. Raises StoreError, beginning with `unusable`, if the folder cannot
    be listed, and whatever `unreadable` raises.
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
