"""Response to a power failure: the run starts no new step while the computer is on battery, and ends in good time."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress

from bench.config.power import PowerEntry
from bench.engine.ending import EndRequest
from bench.engine.journal import Journal
from bench.errors import StoreError
from bench.runner.nut import Client, PowerState
from bench.runner.signals import EndSignal, Signals

EVERY_S = 5.0
IN_WORDS = {
    "line": "The computer is on line power",
    "battery": "The computer is ON BATTERY",
    "low": "The battery of the computer is LOW",
    "unknown": "The state of the power is not known",
}


class Hold:
    """Flag that no step may start while the computer is on battery; `notify` is called on each change."""

    def __init__(self) -> None:
        self._wanted = False
        self._notify: Callable[[bool], object] = lambda _wanted: None

    def want(self, wanted: bool) -> None:
        """Set or clear the hold."""
        if wanted != self._wanted:
            self._wanted = wanted
            self._notify(wanted)

    @contextmanager
    def calling(self, notify: Callable[[bool], object]) -> Iterator[None]:
        """Call `notify` on each change in the block, and at once if the run is already held."""
        self._notify = notify
        if self._wanted:
            notify(True)
        try:
            yield
        finally:
            self._notify = lambda _wanted: None


@asynccontextmanager
async def power_watched(
    entry: PowerEntry | None, signals: Signals, journal: Journal, notice: Callable[[str], object]
) -> AsyncIterator[Hold]:
    """Poll the power state in the block, and hold or end the run as its bench file says.

    Each change is recorded in the journal and shown as a notice. An unknown state ends nothing. Without an entry
    nothing is polled.
    """
    hold = Hold()
    if entry is None:
        yield hold
        return
    watching = asyncio.create_task(_watch(entry, signals, hold, journal, notice), name="power")
    try:
        yield hold
    finally:
        watching.cancel()
        with suppress(asyncio.CancelledError):
            await watching


async def _watch(
    entry: PowerEntry, signals: Signals, hold: Hold, journal: Journal, notice: Callable[[str], object]
) -> None:
    client, policy = Client(entry.ups), Policy(entry)
    try:
        while True:
            state = await client.ask()
            if policy.is_changed(state):
                with suppress(StoreError):  # reported by the step that it stops
                    journal.write("power", state=state.kind, text=state.text)
                notice(f"{IN_WORDS[state.kind]} ({state.text}).")
            if (why := policy.ends(state, asyncio.get_running_loop().time())) is not None:
                signals.request_end(EndSignal("the power failure", EndRequest("power", f"the power failed: {why}")))
                return
            hold.want(policy.holds)
            await asyncio.sleep(EVERY_S)
    finally:
        await client.close()


class Policy:
    """Decision to hold or end a run, from successive power states."""

    def __init__(self, entry: PowerEntry) -> None:
        self._entry = entry
        self._last = ""
        self._since_s: float | None = None  # start of operation on battery; an unknown state does not reset it

    def is_changed(self, state: PowerState) -> bool:
        """Return True if the kind of the state has changed."""
        is_changed, self._last = state.kind != self._last, state.kind
        return is_changed

    @property
    def holds(self) -> bool:
        """True if no step may start now."""
        return self._entry.on_battery == "hold" and self._since_s is not None

    def ends(self, state: PowerState, now_s: float) -> str | None:
        """Return the reason to end the run now, or None."""
        if state.kind == "low":
            return f"the battery is low ({state.text})"
        if state.kind == "line":
            self._since_s = None
        if state.kind != "battery":
            return None
        if self._entry.on_battery == "stop":
            return f"on battery ({state.text})"
        self._since_s = now_s if self._since_s is None else self._since_s
        if now_s - self._since_s >= self._entry.after:
            return f"on battery for {self._entry.after / 60:g} min ({state.text})"
        return None
