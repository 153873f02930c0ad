"""Tests can be collected where no peer is installed: its modules are imported in the tests that need them."""

import ast
from pathlib import Path

from tests.conftest import PEER_MODULES

TESTS = Path(__file__).parents[2]
FOREIGN = {name for modules in PEER_MODULES.values() for name in modules}


def imported_at_once(tree: ast.Module) -> set[str]:
    """The distributions whose modules a module imports when it is imported itself."""
    names = set()
    for node in tree.body:
        if isinstance(node, ast.Import):
            names |= {each.name.partition(".")[0] for each in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names.add(node.module.partition(".")[0])
    return names


def test_modules_of_tests_import_no_peer():
    found = {path: imported_at_once(ast.parse(path.read_text("utf-8"))) & FOREIGN for path in TESTS.rglob("test_*.py")}
    assert len(found) > 300
    assert {str(path): names for path, names in found.items() if names} == {}


def test_an_import_of_a_peer_is_found():
    assert imported_at_once(ast.parse("import psycopg\n\ndef test():\n    import moto\n")) & FOREIGN == {"psycopg"}
