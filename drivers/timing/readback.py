"""Reading back until an instrument tells what it was told.

Many acknowledge a setting before they tell it: a chamber whose display task takes over what its network task took in, a
relay on its way, a gateway that answers out of a table. One look right after the command would take that for a refusal.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class ReadBack:
    """For how long an instrument is asked, and how often, until it tells what it was told; a driver states its own."""

    within_s: float = 2.0
    every_s: float = 0.2

    async def until(self, ask: Callable[[], Awaitable[T]], agrees: Callable[[T], object]) -> T:
        """The first answer that agrees, or what is still told when the time is over: the caller judges that."""
        now_s = asyncio.get_running_loop().time
        over_s = now_s() + self.within_s
        found = await ask()
        while not agrees(found) and now_s() < over_s:
            await asyncio.sleep(self.every_s)
            found = await ask()
        return found
