"""A command of the program in this process."""

from __future__ import annotations

import io
import sys
from contextlib import redirect_stderr, redirect_stdout
from typing import NamedTuple

from bench.cli.main import main


class Done(NamedTuple):
    """How a command ended, and what it wrote."""

    returncode: int
    stdout: str
    stderr: str


def invoked(*words: str, typed: str = "") -> Done:
    """The command with these words, and `typed` on its standard input."""
    before, sys.stdin = sys.stdin, io.StringIO(typed)
    try:
        with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as err:
            code = main(words)
    finally:
        sys.stdin = before
    return Done(code, out.getvalue(), err.getvalue())
