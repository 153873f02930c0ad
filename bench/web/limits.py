"""Limits of requests: their rate, and how many are in progress. Commands that make safe are exempt."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from bench.clock import since_boot_s

PER_S, AT_ONCE = 50.0, 100.0
OF_ALL, OF_ONE = 150, 24  # requests in progress; the rest of the connections is for commands that make safe
KEPT = 4000
MAKES_SAFE = re.compile(r"/api/v1/runs/[^/]+/(?:pause|stop|abort)|/runs/[^/]+/do/(?:pause|stop|stop_after_step|abort)")


def makes_safe(method: str, path: str) -> bool:
    """Return True for a command that makes safe: pause, stop or abort."""
    return method == "POST" and MAKES_SAFE.fullmatch(path) is not None


class BusyError(Exception):
    """Too many requests. `is_of_sender` is True if they are the sender's own."""

    def __init__(self, is_of_sender: bool, why: str) -> None:
        self.is_of_sender = is_of_sender
        super().__init__(why)


class Limits:
    """Rates and numbers of requests by sender: a token, a session, or an address."""

    def __init__(self, now_s: Callable[[], float] = since_boot_s) -> None:
        self._now_s = now_s
        self._left: dict[str, tuple[float, float]] = {}  # requests left at an instant, in the order of use
        self._in_progress: Counter[str] = Counter()

    @contextmanager
    def request(self, sender: str) -> Iterator[None]:
        """Count a request while the block lasts. Raises BusyError."""
        self._count(sender)
        if self._in_progress[sender] >= OF_ONE:
            raise BusyError(True, f"{OF_ONE} requests of yours are in progress; close some of your pages")
        if self._in_progress.total() >= OF_ALL:
            raise BusyError(False, "the station is busy; try again in a second")
        self._in_progress[sender] += 1
        try:
            yield
        finally:
            self._in_progress[sender] -= 1
            if not self._in_progress[sender]:
                del self._in_progress[sender]

    def _count(self, sender: str) -> None:
        now_s = self._now_s()
        left, then_s = self._left.pop(sender, (AT_ONCE, now_s))
        left = min(AT_ONCE, left + PER_S * (now_s - then_s))
        self._left[sender] = (left - 1.0 if left >= 1.0 else left), now_s
        if len(self._left) > KEPT:
            self._left.pop(next(iter(self._left)))
        if left < 1.0:
            raise BusyError(True, f"more than {PER_S:.0f} requests a second; try again in a second")
