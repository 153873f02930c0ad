"""Mutants of a file, by the operators of mutmut, as whole sources; also of decorated functions, which mutmut leaves."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import libcst as cst
from libcst.metadata import MetadataWrapper, PositionProvider
from mutmut.mutation.file_mutation import MutationVisitor
from mutmut.mutation.mutators import mutation_operators
from mutmut.mutation.pragma_handling import IgnoredCode


class Mutant(NamedTuple):
    """A change in the function at `lines` of a file; `key` stays when other code changes, `code` makes the source."""

    key: str
    file: str
    line: int
    lines: range
    change: str
    code: Callable[[], str]

    def fields(self) -> dict[str, object]:
        """Return the fields of the mutant in a line of results."""
        return {"key": self.key, "line": self.line, "change": self.change}

    def place(self, seed: int) -> bytes:
        """Return the place of the mutant in the order of a sample."""
        return hashlib.sha256(f"{seed} {self.key}".encode()).digest()


class _Visitor(MutationVisitor):
    def _skip_node_and_children(self, node: cst.CSTNode) -> bool:
        if isinstance(node, cst.FunctionDef):
            node = node.with_changes(decorators=[])  # they are a hindrance to mutmut's way to switch between mutants
        return bool(super()._skip_node_and_children(node))


def mutants_of(root: Path, file: str) -> Iterator[Mutant]:
    """Yield every mutant of a file; code outside of functions is left as it is, as by mutmut."""
    wrapper = MetadataWrapper(cst.parse_module((root / file).read_text("utf-8")))
    visitor = _Visitor(mutation_operators, IgnoredCode(set(), set(), set()))
    wrapper.visit(visitor)
    found, positions = wrapper.module, wrapper.resolve(PositionProvider)
    seen = Counter[str]()
    for each in visitor.mutations:
        function = each.contained_by_top_level_function
        if not isinstance(function, cst.FunctionDef):
            continue
        old, new = (" ".join(found.code_for_node(node).split()) for node in (each.original_node, each.mutated_node))
        digest = hashlib.sha256(f"{old} {new}".encode()).hexdigest()[:8]
        name = f"{file}:{function.name.value}:{digest}"
        seen[name] += 1
        span = positions[function]
        yield Mutant(
            f"{name}:{seen[name]}", file, positions[each.original_node].start.line,
            range(span.start.line + 1, span.end.line + 1), f"{old} -> {new}",
            partial(_replaced, found, each.original_node, each.mutated_node),
        )  # fmt: skip


def _replaced(module: cst.Module, old: cst.CSTNode, new: cst.CSTNode) -> str:
    return cst.ensure_type(module.deep_replace(old, new), cst.Module).code
