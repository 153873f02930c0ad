"""The operator as part of the bench: turns a device by hand and types what he reads off it.

A driver receives its Person in its Setup, like its connections.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from drivers.errors import CannotConnect
from drivers.values import Approach


class Turn(NamedTuple):
    """An axis to be turned by hand: target angle and side of the final approach."""

    angle_deg: float
    approach: Approach


class OperatorRequest(NamedTuple):
    """A request of a device to the operator: instruction, and the value to be typed, in `unit`.

    `usual_s` is the usual duration, `give_up_s` the time limit for an answer. `turn` is the motion to carry out; None
    if a value is only read off. `again` is True if the previous answer was rejected.
    """

    device: str
    text: str
    unit: str
    usual_s: float
    give_up_s: float
    turn: Turn | None = None
    again: bool = False


class OperatorAnswer(NamedTuple):
    """A typed value, in the requested unit, and the operator's name."""

    value: float
    by: str


class Person(Protocol):
    """Interface to the operator at the bench."""

    async def prompt(self, request: OperatorRequest) -> OperatorAnswer:
        """Prompt the operator; cancelling withdraws the prompt.

        Raises NoAnswer without an answer in time, CannotConnect without an operator.
        """


class _NoOperator:
    """Operator interface outside a run."""

    async def prompt(self, request: OperatorRequest) -> OperatorAnswer:
        raise CannotConnect(
            request.device,
            f"no operator is available: {request.text}",
            remedy="Operators are prompted only during a run.",
        )


NO_OPERATOR: Person = _NoOperator()
"""Raises CannotConnect for every prompt: for drivers opened outside a run."""
