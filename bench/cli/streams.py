"""Standard input, output and error in a usable state, whatever the program was started with."""

from __future__ import annotations

import codecs
import io
import os
import sys

ESCAPED = "bench-escaped"  # error handler of encoders: writes \u00b0 for °, which is also valid in JSON


def make_usable() -> None:
    """Open closed standard streams on the null device; escape characters that their encoding lacks.

    Otherwise the next opened file, such as the run database, would get the descriptor of a closed stream, and output of
    libraries and child processes would be written into it.
    """
    codecs.register_error(ESCAPED, _escaped)
    if sys.stdin is None:
        sys.stdin = _null("r")
    if sys.stdout is None:
        sys.stdout = _null("w")
    if sys.stderr is None:
        sys.stderr = _null("w")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=ESCAPED)


def _null(mode: str) -> io.TextIOWrapper:
    """Open the null device on the lowest free descriptor: that of the closed stream."""
    number = os.open(os.devnull, os.O_RDWR)
    os.set_inheritable(number, True)
    raw = io.FileIO(number, mode, closefd=False)
    return io.TextIOWrapper(io.BufferedReader(raw) if mode == "r" else io.BufferedWriter(raw), encoding="utf-8")


def _escaped(problem: UnicodeError) -> tuple[str, int]:
    if not isinstance(problem, UnicodeEncodeError):
        raise problem
    units = problem.object[problem.start : problem.end].encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{units[at]:02x}{units[at + 1]:02x}" for at in range(0, len(units), 2)), problem.end
