"""A new driver to start from: a package of its own that works as it is, copied from the template of its kind."""

from __future__ import annotations

from pathlib import Path

from bench.app.new_package import expect_free, write_package
from bench.config.load import shipped
from bench.errors import InputError
from drivers.description import known_drivers
from drivers.schema.suggest import did_you_mean


def kinds() -> dict[str, Path]:
    """The kinds of driver that there is a template of, by the capability that they have."""
    folders = [folder / "driver" for folder in shipped("templates")]
    return {path.name: path for folder in folders if folder.is_dir() for path in sorted(folder.iterdir())}


def write_driver(name: str, kind: str, out: Path) -> list[Path]:
    """Writes the package `OUT/NAME`; InputError for a name that is none or taken, or what cannot be written."""
    expect_free(name, "driver", known_drivers())
    if kind not in (known := kinds()):
        raise InputError(f"--kind {kind}: there is no template of that{did_you_mean(kind, known)}")
    return write_package(known[kind], name, out)
