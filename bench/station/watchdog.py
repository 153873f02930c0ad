"""Watchdog of systemd: it restarts a station whose event loop or one of whose parts is stuck."""

from __future__ import annotations

import os
from collections.abc import Sequence

from bench.runner.notify import notify
from bench.station.part import Part

INTERVAL, OF_PROCESS = "WATCHDOG_USEC", "WATCHDOG_PID"


def watchdog_every_s() -> float | None:
    """Return half the interval within which systemd expects a sign of life from this process; None if it does not."""
    text, process = os.environ.get(INTERVAL, ""), os.environ.get(OF_PROCESS, str(os.getpid()))
    if not text.isdigit() or int(text) == 0 or process != str(os.getpid()):
        return None
    return int(text) / 2e6


class Watchdog(Part):
    """Sign of life of a station, given while all parts look within their time."""

    def __init__(self, parts: Sequence[Part], every_s: float) -> None:
        super().__init__()
        self._parts, self.every_s = parts, every_s

    async def look(self) -> None:
        """Give a sign of life, unless a part is stuck."""
        if not any(part.is_stuck for part in self._parts):
            notify("WATCHDOG=1")
