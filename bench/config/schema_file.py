"""Path from a new file to the JSON Schema of its kind, which its first line names for editors."""

from __future__ import annotations

import os
from importlib.resources import files
from pathlib import Path
from typing import Literal

from bench.errors import InputError
from bench.files import written_new

_PACKAGE = Path(str(files("bench")))
_FOLDER = Path("docs/schema")
SHIPPED = _PACKAGE / "shipped" / _FOLDER  # in an installed program


def path_to_schema(kind: Literal["sequence", "bench"], folder: Path) -> str:
    """Return the path from a folder to a schema: in the source tree, or a copy in the folder.

    An installed program moves with its next version and is not on the computer of the recipient of the file, hence the
    copy. An existing one is left as it is. Raises InputError if the copy cannot be written.
    """
    name = f"{kind}.schema.json"
    if not (SHIPPED / name).is_file():
        return os.path.relpath(_PACKAGE.parent / _FOLDER / name, folder.resolve())
    if not (folder / name).exists():
        try:
            with written_new(folder / name) as draft:
                draft.write_bytes((SHIPPED / name).read_bytes())
        except OSError as problem:
            raise InputError(f"{folder / name}: cannot be written ({problem})") from None
    return name
