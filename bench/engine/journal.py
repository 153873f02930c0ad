"""The journal of a run and the state that it leads to, kept together; every entry of a run is written here."""

from __future__ import annotations

import contextlib
from typing import Any

from bench.engine.state import RunState, advanced
from bench.errors import StoreError
from bench.store.writer import RunWriter


class Journal:
    """Writes what happens, and keeps the state of the run up to date by it."""

    def __init__(self, writer: RunWriter, state: RunState | None = None) -> None:
        self.writer = writer
        self.state = state or RunState()

    def write(self, kind: str, step: str = "", **data: Any) -> None:
        """One entry; StoreError when the disk does not take it, and the state is as if it had."""
        self.state = advanced(self.state, kind, step, data)
        self.writer.event(kind, step, **data)

    def try_to_write(self, kind: str, step: str = "", **data: Any) -> None:
        """Write one entry; a failure must not prevent what follows."""
        with contextlib.suppress(StoreError):  # told by the step that it stopped, or by the end of the run
            self.write(kind, step, **data)

    async def commit(self) -> None:
        """Returns when all that was written is on the disk."""
        await self.writer.commit()
