"""Unpacking of archives that the tests bring or have made."""

from __future__ import annotations

import tarfile
from pathlib import Path


def unpack(path: Path, folder: Path) -> None:
    """Unpack a tar file into a folder, without what lies outside of it where Python can tell (3.11.4 and later)."""
    with tarfile.open(path) as archive:
        if hasattr(tarfile, "data_filter"):
            archive.extraction_filter = tarfile.data_filter
        archive.extractall(folder)
