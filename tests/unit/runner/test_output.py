"""Output to a terminal that goes away, or takes nothing more."""

from __future__ import annotations

import contextlib
import os
import pty

import pytest

from bench.runner.output import ThreadedStream, TolerantStream


def write(out, text):
    assert out.write(text) == len(text)
    if isinstance(out, ThreadedStream):
        out.finish()


@pytest.mark.parametrize("kind", [TolerantStream, ThreadedStream])
def test_a_terminal_that_is_closed_takes_no_more_and_raises_nothing(kind):
    near, far = pty.openpty()
    stream = os.fdopen(far, "w")
    out = kind(stream)
    write(out, "before")
    assert os.read(near, 100) == b"before"
    os.close(near)
    write(out, "after")
    assert out.is_gone
    assert not out.isatty()
    write(out, "later")
    with contextlib.suppress(OSError):
        stream.close()


def test_a_terminal_that_takes_nothing_holds_nobody_up():
    near, far = os.pipe()
    with os.fdopen(near, "rb"), os.fdopen(far, "w") as stream:
        out = ThreadedStream(stream)
        for _ in range(40):
            out.write("x" * 10_000)  # a pipe takes 64 KiB
        assert not out.is_gone
