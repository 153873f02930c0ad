"""No module imports itself by way of others, in whatever form: at run time, for types only, or by a string."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[3]
TARGET = re.compile(r"(?:bench|drivers|simulators)(?:\.\w+)+:\w+")  # a function or constant that is loaded when needed
ROOMS = ("bench.methods.", "drivers.dialects.")  # a description there names the modules of its own room
REGISTRIES = {"SHIPPED", "DRIVERS"}  # lists of descriptions, as the entry points of a distribution


@cache
def tree_of(path: Path) -> ast.Module:
    """A parsed module."""
    return ast.parse(path.read_text("utf-8"))


@cache
def modules() -> dict[str, Path]:
    """Every module by its name."""
    found = {}
    for package in ("bench", "drivers", "simulators"):
        for path in (ROOT / package).rglob("*.py"):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def known(name: str) -> str:
    """The module that a dotted name is in; "" if it is none of ours."""
    while name and name not in modules():
        name = name.rpartition(".")[0]
    return name


def imported(tree: ast.AST) -> Iterator[str]:
    """Names of everything imported anywhere in a module, inside functions and for types too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{each.name}" for each in node.names)
        elif isinstance(node, ast.Import):
            yield from (each.name for each in node.names)


def named(tree: ast.Module) -> Iterator[str]:
    """Modules of all strings "module:attribute" outside registries."""
    for statement in tree.body:
        target = getattr(statement, "target", None)
        if isinstance(target, ast.Name) and target.id in REGISTRIES:
            continue
        for node in ast.walk(statement):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and TARGET.fullmatch(node.value):
                yield node.value.partition(":")[0]


def room(module: str) -> str:
    """The room of a module: a method or a dialect counts as one."""
    for prefix in ROOMS:
        if module.startswith(prefix):
            return prefix + module.removeprefix(prefix).partition(".")[0]
    return module


def cycle(graph: dict[str, set[str]]) -> list[str]:
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_no_module_is_in_a_cycle_of_imports():
    graph = {name: {known(each) for each in imported(tree_of(path))} - {name, ""} for name, path in modules().items()}
    assert len(graph) > 700
    assert cycle(graph) == []


def test_no_room_is_in_a_cycle_of_imports_and_of_names_in_strings():
    graph: dict[str, set[str]] = {}
    strings = 0
    for name, path in modules().items():
        tree = tree_of(path)
        named_here = list(named(tree))
        strings += len(named_here)
        if name.startswith("drivers.dialects."):  # each names its simulator, which knows its wire format
            named_here = [each for each in named_here if not each.startswith("simulators.")]
        reached = {room(known(each)) for each in (*imported(tree), *named_here)} - {""}
        graph.setdefault(room(name), set()).update(reached - {room(name)})
    assert strings > 50
    assert cycle(graph) == []
