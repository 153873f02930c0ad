"""No assertion passes because there is nothing to look at, as far as its text shows that."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import _OF_SOMETHING

TESTS = Path(__file__).parents[2]
MODULES = sorted(TESTS.rglob("*.py"))
SEARCHES = {"glob", "rglob", "iterdir", "findall", "finditer"}  # what they find may be nothing


def empty_checks(tree: ast.AST) -> Iterator[str]:
    """What of a module may pass on nothing, with its line."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Assert):
            for default in _defaults(node):
                yield f"line {node.lineno}: {default} of nothing has a value here: assert first that there is something"
        if isinstance(node, ast.For) and _asserts(node) and _may_be_empty(node.iter):
            yield f"line {node.lineno}: this loop asserts nothing where it finds nothing: assert that first"


def _defaults(node: ast.Assert) -> Iterator[str]:
    for call in ast.walk(node.test):
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id in ("max", "min"):
            yield from (call.func.id for keyword in call.keywords if keyword.arg == "default")


def _asserts(node: ast.For) -> bool:
    return any(isinstance(each, ast.Assert) for each in ast.walk(node))


def _may_be_empty(iterated: ast.expr) -> bool:
    """Whether it is a search or a selection, also in order or counted."""
    if isinstance(iterated, (ast.ListComp, ast.GeneratorExp, ast.SetComp)):
        return any(generator.ifs for generator in iterated.generators)
    if not isinstance(iterated, ast.Call):
        return False
    if isinstance(iterated.func, ast.Name) and iterated.func.id in ("sorted", "list", "set", "enumerate", "reversed"):
        return _may_be_empty(iterated.args[0])
    return isinstance(iterated.func, ast.Attribute) and iterated.func.attr in SEARCHES


def test_modules_are_found():
    assert len(MODULES) > 300


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(TESTS)))
def test_nothing_is_no_proof(path):
    assert list(empty_checks(ast.parse(path.read_text("utf-8")))) == []


@pytest.mark.parametrize(
    "text",
    [
        "assert max((abs(each) for each in found), default=99) > 10",
        "assert 0 < min(found, default=1) < 3",
        "for path in sorted(folder.glob('*.csv')):\n    assert path.read_text()",
        "for number, each in enumerate([each for each in found if each.is_far]):\n    assert each.flag",
    ],
)
def test_what_passes_on_nothing_is_seen(text):
    assert len(list(empty_checks(ast.parse(text)))) == 1


def test_all_of_nothing_is_noted():
    assert all(each > 0 for each in [])
    assert all(each > 0 for each in [1, 2])
    assert [some for _, some in sorted(_OF_SOMETHING.items())] == [False, True]
    _OF_SOMETHING.clear()
