"""A pseudo-terminal with a simulated instrument at its other end: a serial port without a cable, in real time."""

from __future__ import annotations

import asyncio
import os
import tty
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from drivers.transport.serial import join_device

TERMINALS = "/dev/pts/"


@asynccontextmanager
async def serve_pty(path: Path, factory: Callable[[], asyncio.Protocol]) -> AsyncIterator[Path]:
    """Link `path` to a new pseudo-terminal answered by `factory()`; removed at exit.

    A link left by an earlier run is replaced; FileExistsError if the path is anything else.
    """
    near, far = os.openpty()
    try:
        # Kept open, so that clients can reconnect; raw, so that bytes pass unchanged.
        tty.setraw(far)
        transport = await join_device(os.fdopen(near, "r+b", buffering=0), factory())
        try:
            _link(path, os.ttyname(far))
            yield path
        finally:
            _unlink(path, os.ttyname(far))
            transport.close()
    finally:
        os.close(far)


def _link(path: Path, terminal: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.is_symlink() and os.readlink(path).startswith(TERMINALS):
        path.unlink()
    path.symlink_to(terminal)


def _unlink(path: Path, terminal: str) -> None:
    """Remove our link, but not another one in its place."""
    if path.is_symlink() and os.readlink(path) == terminal:
        path.unlink()
