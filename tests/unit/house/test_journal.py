"""Every entry of a run goes through its Journal, which keeps the state of the run up to date with it."""

import ast
from pathlib import Path

BENCH = Path(__file__).parents[3] / "bench"


def test_the_journal_alone_writes_entries():
    callers = {
        str(path.relative_to(BENCH))
        for path in BENCH.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "event"
        if not (isinstance(node.func.value, ast.Call) and getattr(node.func.value.func, "id", "") == "super")
    }
    assert callers == {"engine/journal.py"}
