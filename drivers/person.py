"""A person as a part of the bench: does by hand what a device cannot do by itself, and types what he reads off it.

A driver is given its person with its wires; who he is, and how he is reached, is decided where they are made.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from drivers.errors import CannotConnect
from drivers.values import Approach


class Turn(NamedTuple):
    """An axis that is to be turned by hand: to which angle, and from which side it comes there at last."""

    angle_deg: float
    approach: Approach


class Errand(NamedTuple):
    """What a device asks of a person: what he is told, and the value that he then types, in `unit`.

    `takes_s` is how long that usually takes, and `give_up_s` how long an answer is waited for. `turn` is what he is to
    do, where it is more than to look. `again` says that the answer before was not taken.
    """

    device: str
    text: str
    unit: str
    takes_s: float
    give_up_s: float
    turn: Turn | None = None
    again: bool = False


class Typed(NamedTuple):
    """What a person has typed, in the unit that he was asked for, and who he is."""

    value: float
    by: str


class Person(Protocol):
    """Somebody at the bench."""

    async def ask(self, errand: Errand) -> Typed:
        """What he answers; a question that is cancelled is withdrawn.

        Raises NoAnswer when nobody answers in time, CannotConnect where there is nobody to be asked.
        """


class _Nobody:
    """Where no run is under way."""

    async def ask(self, errand: Errand) -> Typed:
        raise CannotConnect(
            errand.device, f"no operator is available: {errand.text}", remedy="Only a run asks people for anything."
        )


NOBODY: Person = _Nobody()
"""Raises CannotConnect whatever is asked: for drivers that are opened outside a run."""
