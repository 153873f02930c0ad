"""Files of other projects that the pages use: fetched as `assets.toml` lists them, checked, and extracted or bundled.

Runs on the standard library alone, because the build of a wheel calls it before anything is installed.
"""

from __future__ import annotations

import base64
import hashlib
import io
import os
import platform
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import urllib.request
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
VENDOR = HERE / "static" / "vendor"
ENTRY = HERE / "codemirror.js"
FOR_TESTS = HERE.parent.parent / "build" / "test_assets"
REGISTRY = "https://registry.npmjs.org"
LIMIT_BYTES = 20_000_000
TIMEOUT_S = 60.0
_AS_ONE_MODULE = (
    "--bundle", "--minify", "--format=esm", "--target=es2022", "--legal-comments=none", "--log-level=error",
    "--tsconfig-raw={}",
)  # fmt: skip
_BUNDLING = "bundling on "  # use of a package, with the kind of computer


class AssetError(Exception):
    """A file cannot be fetched, or is not the one that is listed."""


def packages() -> list[Mapping[str, Any]]:
    """Return the listed packages."""
    listed: list[Mapping[str, Any]] = tomllib.loads((HERE / "assets.toml").read_text("utf-8"))["package"]
    return listed


def lacking() -> list[str]:
    """Return the names of the files of pages that are not there."""
    listed = [package for package in packages() if "for" not in package]
    names = [name for package in listed for name in package.get("files", {}).values()]
    bundles = dict.fromkeys(package["bundle"] for package in listed if "bundle" in package)
    return [name for name in (*names, *bundles) if not (VENDOR / name).is_file()]


def fetch(*, with_tests: bool = True) -> None:
    """Put all listed files and their licences in place. Raises AssetError."""
    listed = packages()
    for package in listed:
        use = package.get("for", "")
        if use.startswith(_BUNDLING) or (use and not with_tests):
            continue
        target = FOR_TESTS if use else VENDOR
        target.mkdir(parents=True, exist_ok=True)
        licence = f"{package['name'].removeprefix('@').replace('/', '-')}.LICENSE"
        _extract(_archive(package), {**package.get("files", {}), "LICENSE": licence}, target)
    for name in dict.fromkeys(package["bundle"] for package in listed if "bundle" in package):
        _write(VENDOR / name, _bundled([package for package in listed if package.get("bundle") == name]))


def _bundled(parts: Sequence[Mapping[str, Any]]) -> bytes:
    """Return one minified module of the packages, as `ENTRY` exports them. Raises AssetError."""
    _cache().mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=_cache()) as made:  # not in /tmp, where some systems start no program
        folder = Path(made)
        for package in parts:
            _extract_all(_archive(package), folder / "node_modules" / package["name"])
        bundler, out = folder / "esbuild", folder / "bundle.js"
        _extract(_archive(_bundler()), {"bin/esbuild": bundler.name}, folder)
        bundler.chmod(0o700)
        _write(folder / ENTRY.name, ENTRY.read_bytes())
        words = [str(bundler), ENTRY.name, *_AS_ONE_MODULE, f"--outfile={out.name}"]
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603  checked above
        if done.returncode != 0:
            raise AssetError(f"{ENTRY}: cannot be bundled ({done.stderr.strip()})")
        return out.read_bytes()


def _bundler() -> Mapping[str, Any]:
    """Return the package of the bundler for this computer. Raises AssetError."""
    machine = platform.machine() if sys.platform == "linux" else sys.platform
    found = next((package for package in packages() if package.get("for") == f"{_BUNDLING}{machine}"), None)
    if found is None:
        raise AssetError(
            f"assets.toml lists no bundler for {machine}. The files are the same everywhere: run make assets on "
            f"another computer and copy its {VENDOR} here, or install a wheel"
        )
    return found


def _archive(package: Mapping[str, Any]) -> bytes:
    """Return the archive of a package, from the cache if it is there."""
    name, integrity = package["name"], package["integrity"]
    file = f"{name.rpartition('/')[2]}-{package['version']}.tgz"
    cached = _cache() / _cached_as(package)
    if cached.is_file() and _integrity(found := cached.read_bytes()) == integrity:
        return found
    url = f"{REGISTRY}/{name}/-/{file}"
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


def _cached_as(package: Mapping[str, Any]) -> str:
    return f"{package['name'].replace('/', '-')}-{package['version']}.tgz"


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


def _extract_all(archive: bytes, target: Path) -> None:
    with tarfile.open(fileobj=io.BytesIO(archive)) as files:
        for entry in files:
            if (member := files.extractfile(entry)) is not None:
                path = target / entry.name.partition("/")[2]
                path.parent.mkdir(parents=True, exist_ok=True)
                _write(path, member.read())


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
