"""The end of a run in good time when its computer is on battery."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress

from bench.config.power import PowerEntry
from bench.engine.ending import EndRequest
from bench.errors import StoreError
from bench.runner.nut import Client, PowerState
from bench.runner.signals import Sent, Signals
from bench.store.writer import RunWriter

EVERY_S = 5.0
IN_WORDS = {
    "line": "The computer is on line power",
    "battery": "The computer is ON BATTERY",
    "low": "The battery of the computer is LOW",
    "unknown": "The state of the power is not known",
}


@asynccontextmanager
async def power_watched(
    entry: PowerEntry | None, signals: Signals, writer: RunWriter, notice: Callable[[str], object]
) -> AsyncIterator[None]:
    """Ask for the state of the power while inside, and end the run as its bench file says; nothing without an entry.

    Each change is an entry of the journal and a notice. A state that is not known ends nothing.
    """
    if entry is None:
        yield
        return
    watching = asyncio.create_task(_watch(entry, signals, writer, notice), name="power")
    try:
        yield
    finally:
        watching.cancel()
        with suppress(asyncio.CancelledError):
            await watching


async def _watch(entry: PowerEntry, signals: Signals, writer: RunWriter, notice: Callable[[str], object]) -> None:
    client, policy = Client(entry.ups), Policy(entry)
    try:
        while True:
            state = await client.ask()
            if policy.is_news(state):
                with suppress(StoreError):  # told by the step that it stops
                    writer.event("power", state=state.kind, text=state.text)
                notice(f"{IN_WORDS[state.kind]} ({state.text}).")
            if (why := policy.ends(state, asyncio.get_running_loop().time())) is not None:
                signals.tell(Sent("the power failure", EndRequest("power", f"the power failed: {why}")))
                return
            await asyncio.sleep(EVERY_S)
    finally:
        await client.close()


class Policy:
    """Decides, from one state of the power to the next, whether a run ends."""

    def __init__(self, entry: PowerEntry) -> None:
        self._entry = entry
        self._last = ""
        self._since_s: float | None = None  # on battery; what is not known does not end it

    def is_news(self, state: PowerState) -> bool:
        """Whether the kind of the state is another one than before."""
        is_news, self._last = state.kind != self._last, state.kind
        return is_news

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
