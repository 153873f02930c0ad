"""Starter package of a plug-in method, copied from the working template."""

from __future__ import annotations

from pathlib import Path

from bench.app.new_package import expect_free, write_package
from bench.config.load import shipped
from bench.sequence.method import known_methods


def write_method(name: str, out: Path) -> list[Path]:
    """Write the package `OUT/NAME`. Raises InputError for an invalid or used name, and errors of writing."""
    expect_free(name, "method", known_methods())
    template = next(path for folder in shipped("templates") if (path := folder / "method").is_dir())
    return write_package(template, name, out)
