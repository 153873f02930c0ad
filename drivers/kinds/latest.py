"""The latest order to an instrument wins: it ends the one under way, which then raises Refused."""

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
        """Raises Refused when it has ended; `sent` was its last command."""
        if self.ended:
            raise self.refusal(sent)

    def refusal(self, sent: str = "") -> Refused:
        """The error of an order that has ended."""
        return Refused(self._device, f"the {self._what} was ended by another command", sent=sent)


class Latest(Generic[T]):
    """The latest order to one instrument, and its result: None before the first order and while one is under way."""

    def __init__(self, device: str, what: str) -> None:
        self._device, self._what = device, what
        self.order = Order(device, what)
        self.result: T | None = None

    def begin(self) -> Order:
        """Ends the order under way and begins another."""
        self.order.ended = True
        self.order, self.result = Order(self._device, self._what), None
        return self.order

    def done(self, order: Order, result: T) -> None:
        """Keeps the result of an order that was carried out, unless another one has begun meanwhile."""
        if not order.ended:
            self.result = result
