"""Standard input, output and error, whatever the program was started with."""

from __future__ import annotations

import codecs
import io
import os
import sys

ESCAPED = "bench-escaped"  # an error handler of encoders: \u00b0 for °, which is also right within JSON


def make_usable() -> None:
    """Open closed standard streams on the null device; write what their encoding does not have as an escape.

    Without it the next file to be opened, such as the store of a run, would be given the number of a closed stream, and
    with it whatever a library or another process writes there.
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
    """The null device, under the lowest number that is free: that of the closed stream."""
    number = os.open(os.devnull, os.O_RDWR)
    os.set_inheritable(number, True)
    raw = io.FileIO(number, mode, closefd=False)
    return io.TextIOWrapper(io.BufferedReader(raw) if mode == "r" else io.BufferedWriter(raw), encoding="utf-8")


def _escaped(problem: UnicodeError) -> tuple[str, int]:
    if not isinstance(problem, UnicodeEncodeError):
        raise problem
    units = problem.object[problem.start : problem.end].encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{units[at]:02x}{units[at + 1]:02x}" for at in range(0, len(units), 2)), problem.end
