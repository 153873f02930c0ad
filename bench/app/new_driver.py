"""Starter package of a plug-in driver, copied from the working template of its kind."""

from __future__ import annotations

from pathlib import Path

from bench.app.new_package import expect_free, write_package
from bench.config.load import shipped
from bench.errors import InputError
from drivers.description import known_drivers
from drivers.schema.suggest import did_you_mean


def kinds() -> dict[str, Path]:
    """Return the templates, by the capability of the driver."""
    folders = [folder / "driver" for folder in shipped("templates")]
    return {path.name: path for folder in folders if folder.is_dir() for path in sorted(folder.iterdir())}


def write_driver(name: str, kind: str, out: Path) -> list[Path]:
    """Write the package `OUT/NAME`. Raises InputError for an invalid or used name, and errors of writing."""
    expect_free(name, "driver", known_drivers())
    if kind not in (known := kinds()):
        raise InputError(f"--kind {kind}: there is no template of this kind{did_you_mean(kind, known)}")
    return write_package(known[kind], name, out)
