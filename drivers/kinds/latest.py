"""Latest order wins: a new order to an instrument supersedes the running one, which then raises Refused."""

from __future__ import annotations

from typing import Generic, TypeVar

from drivers.errors import Refused

T = TypeVar("T")


class Order:
    """One order to an instrument, `ended` once another one has begun."""

    def __init__(self, device: str, what: str) -> None:
        self._device, self._what = device, what
        self.ended = False

    def check(self, sent: str = "") -> None:
        """Raise Refused if it is superseded; `sent` was its last command."""
        if self.ended:
            raise self.refusal(sent)

    def refusal(self, sent: str = "") -> Refused:
        """Exception for a superseded order."""
        return Refused(self._device, f"the {self._what} was ended by another command", sent=sent)


class Latest(Generic[T]):
    """Latest order to one instrument, and its result: None before the first order and during one."""

    def __init__(self, device: str, what: str) -> None:
        self._device, self._what = device, what
        self.order = Order(device, what)
        self.result: T | None = None

    def begin(self) -> Order:
        """End the running order and begin another."""
        self.order.ended = True
        self.order, self.result = Order(self._device, self._what), None
        return self.order

    def done(self, order: Order, result: T) -> None:
        """Store the result of an executed order, unless another one has begun meanwhile."""
        if not order.ended:
            self.result = result
