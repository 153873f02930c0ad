"""A run whose computer is on battery is held, and ends in good time."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress

from bench.config.power import PowerEntry
from bench.engine.ending import EndRequest
from bench.engine.journal import Journal
from bench.errors import StoreError
from bench.runner.nut import Client, PowerState
from bench.runner.signals import Sent, Signals

EVERY_S = 5.0
IN_WORDS = {
    "line": "The computer is on line power",
    "battery": "The computer is ON BATTERY",
    "low": "The battery of the computer is LOW",
    "unknown": "The state of the power is not known",
}


class Hold:
    """Whether a run is to begin no step while its computer is on battery; `tell` is called with each change."""

    def __init__(self) -> None:
        self._wanted = False
        self._tell: Callable[[bool], object] = lambda _wanted: None

    def want(self, wanted: bool) -> None:
        """Hold the run, or let it go on."""
        if wanted != self._wanted:
            self._wanted = wanted
            self._tell(wanted)

    @contextmanager
    def told_to(self, tell: Callable[[bool], object]) -> Iterator[None]:
        """While inside, `tell` is called with each change, and at once if the run is to be held already."""
        self._tell = tell
        if self._wanted:
            tell(True)
        try:
            yield
        finally:
            self._tell = lambda _wanted: None


@asynccontextmanager
async def power_watched(
    entry: PowerEntry | None, signals: Signals, journal: Journal, notice: Callable[[str], object]
) -> AsyncIterator[Hold]:
    """Ask for the state of the power while inside, and hold or end the run as its bench file says.

    Each change is an entry of the journal and a notice. A state that is not known ends nothing. Without an entry
    nothing is asked.
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
            if policy.is_news(state):
                with suppress(StoreError):  # told by the step that it stops
                    journal.write("power", state=state.kind, text=state.text)
                notice(f"{IN_WORDS[state.kind]} ({state.text}).")
            if (why := policy.ends(state, asyncio.get_running_loop().time())) is not None:
                signals.tell(Sent("the power failure", EndRequest("power", f"the power failed: {why}")))
                return
            hold.want(policy.holds)
            await asyncio.sleep(EVERY_S)
    finally:
        await client.close()


class Policy:
    """Decides, from one state of the power to the next, whether a run is held or ends."""

    def __init__(self, entry: PowerEntry) -> None:
        self._entry = entry
        self._last = ""
        self._since_s: float | None = None  # on battery; what is not known does not end it

    def is_news(self, state: PowerState) -> bool:
        """Whether the kind of the state is another one than before."""
        is_news, self._last = state.kind != self._last, state.kind
        return is_news

    @property
    def holds(self) -> bool:
        """Whether the run is to begin no step now."""
        return self._entry.on_battery == "hold" and self._since_s is not None

    def ends(self, state: PowerState, now_s: float) -> str | None:
        """Why the run is to end now, in words; None to go on."""
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
