"""Whether a run directory is as it was written."""

from __future__ import annotations

import hashlib
from pathlib import Path

from bench.errors import StoreError
from bench.store.reader import digest_of
from bench.store.runs import summary


def verify(folder: Path) -> list[str]:
    """What is wrong with a run's files; empty when nothing is. Reads every block, whose checksum must fit."""
    found = summary(folder)
    if not found.manifest:
        return [f"{folder}: has no readable manifest"]
    damage = []
    for name, expected in found.manifest["hashes"].items():
        path = folder / name
        if not path.is_file():
            damage.append(f"{path}: is missing")
        elif expected != "sha256:" + hashlib.sha256(path.read_bytes()).hexdigest():
            damage.append(f"{path}: has changed since it was written")
    try:
        digest = digest_of(folder)
    except StoreError as problem:
        return [*damage, str(problem)]
    if digest != found.manifest.get("digest", digest):
        damage.append(f"{folder}: the data are not those that the manifest was written for")
    return damage
