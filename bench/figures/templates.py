"""Templates of pages."""

from __future__ import annotations

from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from bench.figures.languages import tr


def environment_of(package: str, **known: Any) -> Environment:
    """Return the environment of the templates of a package: text is escaped, unknown names are errors.

    Templates know `tr`, which translates, and `known`.
    """
    environment = Environment(
        loader=PackageLoader(package), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals |= {"tr": tr, **known}
    return environment
