"""Files of other projects that the pages use: fetched as `assets.toml` lists them, checked, and extracted.

Runs on the standard library alone, because the build of a wheel calls it before anything is installed.
"""

from __future__ import annotations

import base64
import hashlib
import io
import os
import sys
import tarfile
import tomllib
import urllib.request
from collections.abc import Mapping
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
VENDOR = HERE / "static" / "vendor"
FOR_TESTS = HERE.parent.parent / "build" / "test_assets"
REGISTRY = "https://registry.npmjs.org"
LIMIT_BYTES = 20_000_000
TIMEOUT_S = 60.0


class AssetError(Exception):
    """A file cannot be fetched, or is not the one that is listed."""


def packages() -> list[Mapping[str, Any]]:
    """Return the listed packages."""
    listed: list[Mapping[str, Any]] = tomllib.loads((HERE / "assets.toml").read_text("utf-8"))["package"]
    return listed


def lacking() -> list[str]:
    """Return the names of the files of pages that are not there."""
    names = [name for package in packages() if "for" not in package for name in package["files"].values()]
    return [name for name in names if not (VENDOR / name).is_file()]


def fetch(*, with_tests: bool = True) -> None:
    """Put all listed files and their licences in place. Raises AssetError."""
    for package in packages():
        if "for" in package and not with_tests:
            continue
        target = FOR_TESTS if "for" in package else VENDOR
        target.mkdir(parents=True, exist_ok=True)
        licence = f"{package['name']}.LICENSE"
        _extract(_archive(package), {**package["files"], "LICENSE": licence}, target)


def _archive(package: Mapping[str, Any]) -> bytes:
    """Return the archive of a package, from the cache if it is there."""
    name, integrity = package["name"], package["integrity"]
    cached = _cache() / f"{name}-{package['version']}.tgz"
    if cached.is_file() and _integrity(found := cached.read_bytes()) == integrity:
        return found
    url = f"{REGISTRY}/{name}/-/{name}-{package['version']}.tgz"
    try:
        with urllib.request.urlopen(url, timeout=TIMEOUT_S) as answer:  # noqa: S310  an https address of our own
            found = bytes(answer.read(LIMIT_BYTES))
    except OSError as problem:
        raise AssetError(
            f"{url}: cannot be fetched ({problem}). The pages need it once; with a network: make assets"
        ) from problem
    if (its := _integrity(found)) != integrity:
        raise AssetError(f"{url}: has the integrity {its}, but assets.toml expects {integrity}; it was not used")
    cached.parent.mkdir(parents=True, exist_ok=True)
    _write(cached, found)
    return found


def _cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "inertial-test-bench" / "npm"


def _integrity(content: bytes) -> str:
    return "sha512-" + base64.b64encode(hashlib.sha512(content).digest()).decode()


def _extract(archive: bytes, wanted: Mapping[str, str], target: Path) -> None:
    with tarfile.open(fileobj=io.BytesIO(archive)) as files:
        for inside, name in wanted.items():
            member = files.extractfile(f"package/{inside}")
            if member is None:
                raise AssetError(f"the archive has no file {inside}")
            _write(target / name, member.read())


def _write(path: Path, content: bytes) -> None:
    """Write a file as a whole, since two builds may do so at once."""
    part = path.with_name(f".{path.name}.{os.getpid()}")
    part.write_bytes(content)
    part.replace(path)


if __name__ == "__main__":
    try:
        fetch()
    except AssetError as problem:
        sys.exit(str(problem))
