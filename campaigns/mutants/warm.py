"""A session of pytest that tries mutants: modules are imported and tests collected once, each mutant is a fork.

In a fork the changed code replaces that of the functions that are there. What runs only when a module is imported, or
in another process, stays as it is: a mutant that survives here meets all tests as a changed file, with --far.
"""

from __future__ import annotations

import gc
import os
import shutil
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from types import CodeType, FunctionType, SimpleNamespace
from typing import TYPE_CHECKING

import pytest
from coverage import Coverage

from campaigns.mutants.sandbox import contained

if TYPE_CHECKING:
    from campaigns.mutants.mutants import Mutant

LIMIT_S = 60.0


class Warm:
    """A plugin of pytest: in place of the tests, `each` is called with what tries a mutant."""

    def __init__(self, folder: Path, each: Callable[[Warm], None]) -> None:
        self._folder, self._each = folder, each
        self._has_mutant = False
        self._log = Path(f"{folder}.txt")
        self._lines: dict[str, dict[int, set[str]]] = {}
        self._took_s: dict[str, float] = {}

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Run all tests once, to know what each goes through, and once in a fork; then try the mutants."""
        self._items = {item.nodeid: item for item in session.items}
        cover = Coverage(
            data_file=None, source=[str(self._folder / name) for name in ("bench", "drivers")], config_file=False
        )
        cover.start()
        for item in session.items:
            cover.switch_context(item.nodeid)
            began_s = time.perf_counter()
            assert not self._failing([item]), f"{item.nodeid} fails without a mutant, see {self._log}"
            self._took_s[item.nodeid] = time.perf_counter() - began_s
        cover.stop()
        data = cover.get_data()
        for file in data.measured_files():
            name = str(Path(file).relative_to(self._folder))
            self._lines[name] = {line: set(tests) for line, tests in data.contexts_by_lineno(file).items()}
        while contained(lambda: self._failing(self._items.values()), 10 * LIMIT_S):
            name = self._log.read_text("utf-8").partition("\n")[0]
            del self._items[name]  # one that does not pass wherever it is, as on a busy machine, proves nothing
            assert len(self._items) > len(session.items) - 5, f"too many tests fail in a fork, see {self._log}"
        self._each(self)
        return True

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note which test has failed, and why; with a mutant the first failure is the end."""
        if report.failed:
            self._log.write_text(f"{report.nodeid}\n{report.longreprtext}\n", "utf-8")
            if self._has_mutant:
                os._exit(1)

    def through(self, mutant: Mutant) -> list[str]:
        """Return the tests that enter the function of a mutant, short ones first."""
        lines = self._lines.get(mutant.file, {})
        tests = set().union(*(lines.get(line, ()) for line in mutant.lines)) & self._items.keys()
        return sorted(tests, key=self._took_s.__getitem__)

    def tried(self, mutant: Mutant, tests: Sequence[str]) -> int:
        """Return 0 if all of the tests pass with the mutant."""

        state = Path(f"{self._folder}.itb-state-")  # a mutant may spoil what others read there
        shutil.rmtree(state, ignore_errors=True)
        shutil.copytree(os.environ["XDG_STATE_HOME"], state)

        def work() -> int:
            self._has_mutant = True
            os.environ["XDG_STATE_HOME"] = str(state)
            replace_code(str(self._folder / mutant.file), mutant.code())
            return self._failing([self._items[each] for each in tests])

        return contained(work, LIMIT_S)

    def _failing(self, items: Iterable[pytest.Item]) -> int:
        """Run tests until one fails; return 1 if one did. What belongs to the session stays for the next ones."""
        for item in items:
            failed = item.session.testsfailed
            between = SimpleNamespace(listchain=lambda session=item.session: [session])
            item.ihook.pytest_runtest_protocol(item=item, nextitem=between)
            if item.session.testsfailed > failed:
                return 1
        return 0


def replace_code(file: str, source: str) -> None:
    """Replace the code of all functions that were imported from a file by that of another source."""
    new = _by_name(_codes(compile(source, file, "exec", dont_inherit=True)))
    functions = [
        each for each in gc.get_objects()
        if isinstance(each, FunctionType) and each.__code__.co_filename == file
        and "<locals>" not in each.__code__.co_qualname
    ]  # fmt: skip
    old = _by_name({each.__code__ for each in functions})
    for each in functions:
        name = each.__code__.co_qualname
        if len(new[name]) == len(old[name]):
            code = new[name][old[name].index(each.__code__)]
            if code.co_freevars == each.__code__.co_freevars:
                each.__code__ = code


def _codes(code: CodeType) -> set[CodeType]:
    found: set[CodeType] = set()
    for each in code.co_consts:
        if isinstance(each, CodeType):
            found |= {each} | _codes(each)
    return {each for each in found if "<locals>" not in each.co_qualname}


def _by_name(codes: Iterable[CodeType]) -> dict[str, list[CodeType]]:
    found: dict[str, list[CodeType]] = defaultdict(list)
    for each in sorted(codes, key=lambda code: code.co_firstlineno):
        found[each.co_qualname].append(each)
    return found
