"""Identity of the program, which must be equal on all computers of a campaign."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator, Mapping
from functools import lru_cache
from importlib.metadata import distributions, version
from importlib.resources import files
from pathlib import Path

from bench.campaign.tasks import canonical

ROOT = Path(str(files("bench"))).parent
PACKAGES = ("bench", "drivers", "simulators")
BESIDE = ("config", "sequences", "campaigns", "tests/support", "tests/truth")  # in the sources
PAGES = "bench/web"  # on which no result depends, and where `make assets` puts files
READ = frozenset({".py", ".yaml", ".dbc", ".csv", ".json", ".toml"})
LIBRARIES = ("numpy", "scipy", "pydantic", "cantools")  # on which numbers or plans depend
PLUG_INS = "inertial_test_bench."


@lru_cache(maxsize=1)
def identity() -> Mapping[str, str]:
    """Version and digest of the sources, the interpreter, libraries that results depend on, and plug-ins."""
    known = {"inertial-test-bench": version("inertial-test-bench"), "sources": _sources()}
    known["python"] = f"{sys.version_info.major}.{sys.version_info.minor}"
    return known | {name: version(name) for name in LIBRARIES} | dict(_plug_ins())


def digest_of(known: Mapping[str, str]) -> str:
    """Short digest of an identity."""
    return hashlib.sha256(canonical(dict(known)).encode()).hexdigest()[:16]


def present() -> str:
    """Return the version and the digest of this program, as an archive has them of a re-reduction."""
    return f"{version('inertial-test-bench')} {digest_of(identity())}"


def differences(wanted: Mapping[str, str], found: Mapping[str, str]) -> list[str]:
    """Return "numpy 2.2.1 instead of 2.3.0" for each part in which an identity is not the wanted one."""
    return [
        f"{part} {found.get(part, 'missing')} instead of {wanted.get(part, 'none')}"
        for part in sorted({*wanted, *found})
        if found.get(part) != wanted.get(part)
    ]


def _sources() -> str:
    """Digest of the names and contents of all files."""
    digest = hashlib.sha256()
    for part in (*PACKAGES, *(BESIDE if (ROOT / "pyproject.toml").is_file() else ())):
        for path in sorted(path for path in (ROOT / part).rglob("*") if path.suffix in READ and path.is_file()):
            if not path.is_relative_to(ROOT / PAGES):
                digest.update(f"{path.relative_to(ROOT)}\0".encode() + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:16]


def _plug_ins() -> Iterator[tuple[str, str]]:
    for found in distributions():
        if found.name != "inertial-test-bench" and any(e.group.startswith(PLUG_INS) for e in found.entry_points):
            yield found.name, found.version
