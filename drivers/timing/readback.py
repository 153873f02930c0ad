"""Repeated reading back until an instrument reports the value that was set.

Many instruments acknowledge a setting before they report it: a chamber whose display task copies values from its
network task, a switching relay, a gateway with cached values. A single read-back right after the command would mistake
that for a refusal.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import TypeVar

T = TypeVar("T")

WITHIN_S, EVERY_S = 2.0, 0.2


async def read_back(read: Callable[[], Awaitable[T]], agrees: Callable[[T], object]) -> T:
    """First answer that agrees, or the last one at the time limit, for the caller to judge."""
    now_s = asyncio.get_running_loop().time
    over_s = now_s() + WITHIN_S
    found = await read()
    while not agrees(found) and now_s() < over_s:
        await asyncio.sleep(EVERY_S)
        found = await read()
    return found
