"""Double reading of values that enter a result, if the connection has no checksum."""

from __future__ import annotations

import operator
from collections.abc import Awaitable, Callable
from typing import TypeVar

from drivers.errors import BadAnswer

T = TypeVar("T")


class Takes:
    """Double reads over the connection to one instrument; `note` is called if they disagree.

    With `checked` one read is enough: the connection has a checksum, so that a corrupted answer is discarded.
    """

    def __init__(self, device: str, note: Callable[[str], object], *, checked: bool) -> None:
        self._device, self._note, self._checked = device, note, checked
        self._orders = 0

    def ordered(self) -> None:
        """Note that a command was sent, which may change the readings."""
        self._orders += 1

    async def agreed(
        self, what: str, take: Callable[[], Awaitable[T]], *, alike: Callable[[T, T], object] = operator.eq,
        again: Callable[[], Awaitable[T]] | None = None, spell: Callable[[T], object] = str,
    ) -> T:  # fmt: skip
        """Confirmed reading: one read if that is enough, else two that are `alike`; otherwise a third decides.

        `alike` returns whether two reads of a changing value agree. `again` repeats the same reading, if the instrument
        has stored it. `what` is its name in messages, and `spell` formats its value. Raises BadAnswer if the third
        agrees with neither; after a command in between, all reads are repeated.
        """
        again = again or take
        while True:
            orders = self._orders
            first = await take()
            if self._checked:
                return first
            second = await again()
            if alike(first, second):
                return second
            third = await again()
            if alike(first, third) or alike(second, third):
                self._note(f"{what} was reported as {spell(first)}, then as {spell(second)}; repeated: {spell(third)}")
                return third
            if orders == self._orders:
                raise BadAnswer(
                    self._device, f"{what} was reported three times, with no two equal",
                    received=f"{spell(first)}; {spell(second)}; {spell(third)}",
                    remedy="This line has no checksum: check its cable, its shield and its baud rate.",
                )  # fmt: skip
