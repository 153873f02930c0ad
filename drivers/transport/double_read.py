"""Double reading of values that enter a result, if the connection has no checksum."""

from __future__ import annotations

import operator
from collections.abc import Awaitable, Callable
from typing import TypeVar

from drivers.errors import BadAnswer

T = TypeVar("T")


class DoubleRead:
    """Double reads over the connection to one instrument; `note` is called if they disagree.

    With `checked` one read is enough: the connection has a checksum, so that a corrupted answer is discarded.
    """

    def __init__(self, device: str, note: Callable[[str], object], *, checked: bool) -> None:
        self._device, self._note, self._checked = device, note, checked
        self._commands_sent = 0

    def command_sent(self) -> None:
        """Note that a command was sent, which may change the readings."""
        self._commands_sent += 1

    async def confirmed(
        self, what: str, read: Callable[[], Awaitable[T]], *, agree: Callable[[T, T], object] = operator.eq,
        repeat: Callable[[], Awaitable[T]] | None = None, describe: Callable[[T], object] = str,
    ) -> T:  # fmt: skip
        """Confirmed reading: one read if that is enough, else two that are `agree`; otherwise a third decides.

        `agree` returns whether two reads of a changing value agree. `repeat` repeats the same reading, if the
        instrument has stored it. `what` is its name in messages, and `describe` formats its value. Raises BadAnswer if
        the third agrees with neither; after a command in between, all reads are repeated.
        """
        repeat = repeat or read
        while True:
            sent = self._commands_sent
            first = await read()
            if self._checked:
                return first
            second = await repeat()
            if agree(first, second):
                return second
            third = await repeat()
            if agree(first, third) or agree(second, third):
                self._note(
                    f"{what} was reported as {describe(first)}, then as {describe(second)}; repeated: {describe(third)}"
                )
                return third
            if sent == self._commands_sent:
                raise BadAnswer(
                    self._device, f"{what} was reported three times, with no two equal",
                    received=f"{describe(first)}; {describe(second)}; {describe(third)}",
                    remedy="This line has no checksum: check its cable, its shield and its baud rate.",
                )  # fmt: skip
