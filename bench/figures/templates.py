"""Templates of pages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from jinja2 import BytecodeCache, Environment, PackageLoader, StrictUndefined
from jinja2.bccache import Bucket

from bench.figures.languages import tr


class Compiled(BytecodeCache):
    """Compiled templates in memory, by the keys of jinja2: those that another process has compiled, and our own."""

    def __init__(self) -> None:
        self.kept: dict[str, bytes] = {}

    def load_bytecode(self, bucket: Bucket) -> None:
        """Load a template that is kept; one whose source has changed is compiled again."""
        if (found := self.kept.get(bucket.key)) is not None:
            bucket.bytecode_from_string(found)

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep a template."""
        self.kept[bucket.key] = bucket.bytecode_to_string()


def compiled(package: str) -> Mapping[str, bytes]:
    """Compile all templates of a package, which takes half a second; for `Compiled.kept` of another process."""
    kept = Compiled()
    environment = environment_of(package, kept)
    for name in environment.list_templates():
        environment.get_template(name)
    return kept.kept


def environment_of(package: str, kept: Compiled | None = None, **known: Any) -> Environment:
    """Return the environment of the templates of a package: text is escaped, unknown names are errors.

    Templates know `tr`, which translates, and `known`.
    """
    environment = Environment(
        loader=PackageLoader(package), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        bytecode_cache=kept,
    )  # fmt: skip
    environment.globals |= {"tr": tr, **known}
    return environment
