"""A mutant takes the place of code that is there already, and its tests leave nothing behind."""

import os
import sys
import time

import pytest

from campaigns.mutants.sandbox import BROKEN, TIMED_OUT, contained
from campaigns.mutants.warm import replace_code

SOURCE = """\
from contextlib import contextmanager

def plain(a):
    return [each + 1 for each in a]

class Class:
    @property
    def value(self):
        return 1

    @value.setter
    def value(self, given):
        self.given = given + 1

    @classmethod
    def make(cls):
        return super().__new__(cls), 1

@contextmanager
def block():
    yield 1
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    (tmp_path / "of_a_test.py").write_text(SOURCE, "utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    yield __import__("of_a_test")
    del sys.modules["of_a_test"]


def test_every_kind_of_function_gets_its_new_code(module):
    replace_code(module.__file__, SOURCE.replace("1", "3"))
    made, number = module.Class.make()
    made.value = 1
    with module.block() as found:
        assert (module.plain([0]), made.value, made.given, number, found) == ([3], 3, 4, 3, 3)


def test_a_source_with_other_lines_is_matched_by_name_and_order(module):
    replace_code(module.__file__, "\n" + SOURCE.replace("def make(cls):", "def make(\n  cls):").replace("+ 1", "- 1"))
    made, number = module.Class.make()
    made.value = 1
    assert (module.plain([0]), made.value, made.given, number) == ([-1], 1, 0, 1)


@pytest.mark.skipif(os.getuid() != 0, reason="root may make namespaces")
def test_what_runs_is_contained_and_ends_in_time(tmp_path):
    def leaves() -> int:
        if not os.fork():
            time.sleep(0.5)
            (tmp_path / "left").touch()
            os._exit(0)
        return 7

    assert contained(leaves, 10.0) == 7
    assert contained(lambda: time.sleep(60) or 0, 0.2) == TIMED_OUT
    assert contained(lambda: 1 // 0, 10.0) == BROKEN
    time.sleep(0.7)
    assert not (tmp_path / "left").exists()
