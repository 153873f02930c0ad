"""Answers typed where a run was started."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from bench.engine.engine import Observer
from bench.engine.questions import Desk
from bench.errors import InputError


@contextmanager
def answers_from_terminal(desk: Desk, observer: Observer, *, can_wait: bool) -> Iterator[None]:
    """While inside, a line typed on the terminal answers the open question; nothing where there is no terminal."""
    if not can_wait or not sys.stdin.isatty():
        yield
        return
    loop = asyncio.get_running_loop()

    def typed() -> None:
        line = sys.stdin.readline()
        if not line:
            loop.remove_reader(sys.stdin)
        elif desk.questions:
            try:
                desk.answer(line, os.environ.get("USER", "operator"))
            except InputError as problem:
                observer.notice(str(problem))

    loop.add_reader(sys.stdin, typed)
    try:
        yield
    finally:
        loop.remove_reader(sys.stdin)
