"""A computer whose clocks go with the bench time of a virtual run, and are set, slewed and stopped by a plan.

As a program: a process that runs on such a computer until it is killed, told as JSON what to run.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from datetime import UTC, datetime, tzinfo
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

from bench.app.execute import execute
from bench.app.request import RunRequest, prepare
from tests.support.killed import Killed

ZONE = "Europe/Berlin"


class Change(NamedTuple):
    """Something that happens to the clocks at an instant of bench time, in s.

    "set" sets the clock by `by_s`; "slew" makes it faster by `by_s` for each second from then on; in "sleep" the
    computer sleeps for `by_s`.
    """

    at_s: float
    kind: str
    by_s: float


class WallClock:
    """The clocks of a computer: that of the wall, that since boot, and that which stands still while it sleeps.

    `seen_s` is the bench time at which it begins, from when on `changes` happen; those before have happened.
    """

    CLOCK_BOOTTIME = time.CLOCK_BOOTTIME

    def __init__(self, epoch_s: float, changes: Sequence[Change], seen_s: float = 0.0) -> None:
        self._epoch_s, self._changes, self._seen_s = epoch_s, changes, seen_s

    def _bench_s(self) -> float:
        with suppress(RuntimeError):  # no loop is running: nothing has passed since it did
            self._seen_s = max(self._seen_s, asyncio.get_running_loop().time())
        return self._seen_s

    def monotonic(self) -> float:
        """Without the computer's sleep."""
        return self._bench_s()

    def clock_gettime(self, _which: int) -> float:
        """With it."""
        now_s = self._bench_s()
        return now_s + sum(each.by_s for each in self._changes if each.kind == "sleep" and each.at_s <= now_s)

    def time(self) -> float:
        """That of the wall, since 1970."""
        now_s, found_s = self._bench_s(), self._epoch_s + self.clock_gettime(0)
        for each in self._changes:
            if each.at_s <= now_s and each.kind == "set":
                found_s += each.by_s
            elif each.at_s <= now_s and each.kind == "slew":
                found_s += each.by_s * (now_s - each.at_s)
        return found_s

    @contextmanager
    def used(self) -> Iterator[None]:
        """All that looks at a clock of the computer looks at this one, in a time zone with daylight saving."""
        clock = self

        class Now(datetime):
            @classmethod
            def now(cls, tz: tzinfo | None = None) -> Any:
                return datetime.fromtimestamp(clock.time(), tz)

        with ExitStack() as stack:
            stack.enter_context(patch.dict(os.environ, {"TZ": ZONE}))
            time.tzset()
            stack.callback(time.tzset)
            stack.enter_context(patch("bench.clock.time", clock))
            stack.enter_context(patch("bench.clock.datetime", Now))
            yield
        time.tzset()


def epoch_of(instant: str) -> float:
    """The seconds since 1970 of a UTC instant."""
    return datetime.fromisoformat(instant).replace(tzinfo=UTC).timestamp()


def main(wish: dict[str, Any]) -> None:
    """Run until killed."""
    changes = [Change(*each) for each in wish["changes"]]
    with WallClock(wish["epoch_s"], changes).used():
        request = RunRequest(wish["sequence"], bench=wish["bench"], runs=Path(wish["runs"]))
        execute(prepare(request), Killed(wish["at_s"]))


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
