"""Readings that enter a result are taken twice if the connection has no checksum."""

from __future__ import annotations

import operator
from collections.abc import Awaitable, Callable
from typing import TypeVar

from drivers.errors import BadAnswer

T = TypeVar("T")


class Takes:
    """Takes of the same reading over the way to one instrument; `note` is told when they disagree.

    With `checked` one is enough: the way has a checksum, so that an altered answer does not arrive as an answer.
    """

    def __init__(self, device: str, note: Callable[[str], object], *, checked: bool) -> None:
        self._device, self._note, self._checked = device, note, checked
        self._orders = 0

    def ordered(self) -> None:
        """A command was sent, which may change the readings."""
        self._orders += 1

    async def agreed(
        self, what: str, take: Callable[[], Awaitable[T]], *, alike: Callable[[T, T], object] = operator.eq,
        again: Callable[[], Awaitable[T]] | None = None, spell: Callable[[T], object] = str,
    ) -> T:  # fmt: skip
        """One take where one is enough, else the last of two that are `alike`; of two that are not, a third decides.

        `alike` says by how much two takes of what changes may differ. `again` takes the same reading once more, where
        the instrument still has it. `what` is its name for a person, and `spell` writes its value. Raises BadAnswer
        when the third is like neither; where a command has gone out meanwhile, all are taken anew.
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
