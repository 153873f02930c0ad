"""Sign of life of a station for its service manager."""

from __future__ import annotations

import os

from bench.runner.notify import notify
from bench.station.part import Part

PERIOD = "WATCHDOG_USEC"  # of systemd: time without a sign after which it kills the service


class Watchdog(Part):
    """Part that sends a sign of life from the event loop of all parts, twice in the time allowed for one."""

    def __init__(self) -> None:
        super().__init__()
        allowed = os.environ.get(PERIOD, "")
        self.every_s = int(allowed) / 2e6 if allowed.isdecimal() else 10.0

    async def look(self) -> None:
        """Send a sign of life."""
        notify("WATCHDOG=1")
