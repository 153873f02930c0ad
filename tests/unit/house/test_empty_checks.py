"""No assertion passes because there is nothing to look at, as far as its text shows that."""

import ast
from collections.abc import Collection, Iterator
from pathlib import Path

import pytest

from tests.conftest import _OF_SOMETHING

TESTS = Path(__file__).parents[2]
MODULES = sorted(TESTS.rglob("*.py"))
# What they find may be nothing.
SEARCHES = {"glob", "rglob", "iterdir", "findall", "finditer", "events", "blocks", "splitlines"}
SAME_LENGTH = {"sorted", "list", "tuple", "set", "enumerate", "reversed"}
NOTHING = {"[]", "()", "{}", "set()"}
Function = ast.FunctionDef | ast.AsyncFunctionDef


def empty_checks(tree: ast.AST) -> Iterator[str]:
    """What of a module may pass on nothing, with its line."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Assert):
            for default in _defaults(node):
                yield f"line {node.lineno}: {default} of nothing has a value here: assert first that there is something"
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "pytest.raises" and _is_any(node.args[0]):
            yield f"line {node.lineno}: any error passes, a mistake in the test too: name the class"
        if isinstance(node, Function):
            yield from _unproved(node)
    yield from _unproved(tree)


def _defaults(node: ast.Assert) -> Iterator[str]:
    for call in ast.walk(node.test):
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id in ("max", "min"):
            yield from (call.func.id for keyword in call.keywords if keyword.arg == "default")


def _is_any(error: ast.expr) -> bool:
    return isinstance(error, ast.Name) and error.id in ("Exception", "BaseException")


def _unproved(function: ast.AST) -> Iterator[str]:
    """Loops and empty lists of a function that assert nothing where what they look through is empty.

    What a search or a selection found under a name may be looked through if another assertion has that name.
    """
    nodes = list(_own(function))
    names: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and _may_be_empty(node.value, names):
            names.add(node.targets[0].id)
    asserted = [node for node in nodes if isinstance(node, ast.Assert)]
    for node in nodes:
        for iterated in _looked_through(node):
            others = [each for each in asserted if each not in set(ast.walk(node))]
            if _may_be_empty(iterated, names) and not _named(iterated) & names & _named(*others):
                yield f"line {node.lineno}: nothing is asserted of what finds nothing: assert first that it finds some"


def _own(node: ast.AST) -> Iterator[ast.stmt | ast.AST]:
    """All nodes of a function without those of functions in it."""
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, Function):
            yield child
            yield from _own(child)


def _looked_through(node: ast.AST) -> Iterator[ast.expr]:
    """What a loop with assertions goes through, and what an assertion goes through for there to be nothing wrong."""
    if isinstance(node, ast.For) and any(isinstance(each, ast.Assert) for each in ast.walk(node)):
        yield node.iter
    if isinstance(node, ast.Assert) and (nothing := _said_to_be_nothing(node.test)) is not None:
        for each in ast.walk(nothing):
            if isinstance(each, ast.ListComp | ast.SetComp | ast.GeneratorExp | ast.DictComp):
                yield each.generators[0].iter


def _said_to_be_nothing(test: ast.expr) -> ast.expr | None:
    if isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not):
        return test.operand
    if isinstance(test, ast.Compare) and isinstance(test.ops[0], ast.Eq):
        return test.left if ast.unparse(test.comparators[0]) in NOTHING else None
    return None


def _named(*nodes: ast.AST) -> set[str]:
    return {each.id for node in nodes for each in ast.walk(node) if isinstance(each, ast.Name)}


def _may_be_empty(iterated: ast.expr, names: Collection[str]) -> bool:
    """Whether it is a search or a selection, or a name of one, also in order or counted."""
    if isinstance(iterated, ast.ListComp | ast.GeneratorExp | ast.SetComp | ast.DictComp):
        return any(each.ifs or _may_be_empty(each.iter, names) for each in iterated.generators)
    if isinstance(iterated, ast.Name):
        return iterated.id in names
    if not isinstance(iterated, ast.Call):
        return False
    if isinstance(iterated.func, ast.Name) and iterated.func.id in SAME_LENGTH and iterated.args:
        return _may_be_empty(iterated.args[0], names)
    if not isinstance(iterated.func, ast.Attribute):
        return False
    if iterated.func.attr in ("items", "keys", "values"):
        return _may_be_empty(iterated.func.value, names)
    return iterated.func.attr in SEARCHES


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
        "def test():\n    far = [each for each in all_ if each.far]\n    for each in far:\n        assert each.flag",
        "def test():\n    paths = sorted(folder.glob('*'))\n    assert [path for path in paths if bad(path)] == []",
        "def test():\n    assert not {event.data for event in reader.events('step_ended') if event.is_bad}",
        "with pytest.raises(Exception, match='no'):\n    run()",
    ],
)
def test_what_passes_on_nothing_is_seen(text):
    assert len(list(empty_checks(ast.parse(text)))) == 1


@pytest.mark.parametrize(
    "text",
    [
        "def test():\n    far = [each for each in found if each.is_far]\n    assert far\n    for each in far:\n"
        "        assert each.flag",
        "def test():\n    paths = list(folder.glob('*'))\n    assert len(paths) > 3\n"
        "    assert [path for path in paths if is_bad(path)] == []",
        "def test():\n    assert [event.step for event in reader.events('step_ended')] == ['a', 'b']",
        "with pytest.raises(ValueError, match='no'):\n    run()",
    ],
)
def test_what_is_proved_before_is_not_told(text):
    assert list(empty_checks(ast.parse(text))) == []


def test_all_of_nothing_is_noted():
    assert all(each > 0 for each in [])
    assert all(each > 0 for each in [1, 2])
    assert [some for _, some in sorted(_OF_SOMETHING.items())] == [False, True]
    _OF_SOMETHING.clear()
