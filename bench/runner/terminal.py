"""Input from the terminal on which this program was started."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager

from bench.engine.engine import Observer
from bench.engine.questions import PromptQueue
from bench.errors import InputError

READ_AT_ONCE_BYTES = 4096


@contextmanager
def answers_from_terminal(prompts: PromptQueue, observer: Observer, *, can_wait: bool) -> Iterator[None]:
    """Answer open questions with lines typed on the terminal during the block; no effect without a terminal."""
    if not can_wait or not _is_a_terminal():
        yield
        return
    loop = asyncio.get_running_loop()

    def typed() -> None:
        try:
            line = sys.stdin.readline()
        except (OSError, ValueError):  # the terminal is gone, or belongs to another program now
            line = ""
        if not line:
            loop.remove_reader(sys.stdin)
        elif prompts.questions:
            try:
                prompts.answer(line, os.environ.get("USER", "operator"))
            except InputError as problem:
                observer.notice(str(problem))

    loop.add_reader(sys.stdin, typed)
    try:
        yield
    finally:
        loop.remove_reader(sys.stdin)


def _is_a_terminal() -> bool:
    with contextlib.suppress(OSError, ValueError):
        return sys.stdin is not None and sys.stdin.isatty()
    return False


async def typed_lines() -> AsyncIterator[str]:
    """Yield the lines of the standard input as they are typed, until its end."""
    loop = asyncio.get_running_loop()
    received: asyncio.Queue[bytes] = asyncio.Queue()
    try:
        descriptor = sys.stdin.fileno()
        loop.add_reader(descriptor, lambda: received.put_nowait(os.read(descriptor, READ_AT_ONCE_BYTES)))
    except (OSError, ValueError):  # a regular file, which cannot be polled, or no descriptor
        for line in sys.stdin:
            yield line.rstrip("\n")
        return
    rest = b""
    try:
        while data := await received.get():
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                yield line.decode(errors="replace")
        if rest:
            yield rest.decode(errors="replace")
    finally:
        loop.remove_reader(descriptor)
