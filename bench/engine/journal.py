"""Journal of a run and the state derived from it, kept in step; every entry of a run is written here."""

from __future__ import annotations

import contextlib
from typing import Any

from bench.engine.state import RunState, advanced
from bench.errors import StoreError
from bench.store.writer import RunWriter


class Journal:
    """Write the events of a run and update its state with each."""

    def __init__(self, writer: RunWriter, state: RunState | None = None) -> None:
        self.writer = writer
        self.state = state or RunState()

    def write(self, kind: str, step: str = "", **data: Any) -> None:
        """Write one entry. Raise StoreError if the disk rejects it; the state is then updated all the same."""
        self.state = advanced(self.state, kind, step, data)
        self.writer.event(kind, step, **data)

    def try_to_write(self, kind: str, step: str = "", **data: Any) -> None:
        """Write one entry; a failure must not prevent what follows."""
        with contextlib.suppress(StoreError):  # reported by the step that it stopped, or at the end of the run
            self.write(kind, step, **data)

    async def commit(self) -> None:
        """Wait until all entries are on the disk."""
        await self.writer.commit()
