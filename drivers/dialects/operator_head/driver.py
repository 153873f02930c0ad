"""An indexing head that a person turns: he is asked to, and what he types is where it stands."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping, Sequence
from typing import Self

from drivers.certificates.corrections import TURN_DEG
from drivers.description import Nothing, Setup
from drivers.dialects.operator_head import wording
from drivers.dialects.operator_head.description import OperatorHeadLimits, OperatorHeadOptions
from drivers.errors import BeyondLimit, Refused
from drivers.kinds.head.bounds import check_angle
from drivers.kinds.latest import Latest, Order
from drivers.person import Errand, Turn, Typed
from drivers.values import Approach, Identity, Reading

MOST_ANSWERS = 5  # to one move, before the person and the sequence plainly mean different things


class OperatorHead:
    """A head without a motor or a wire; a Positioner.

    It stands where a person has last said; it is not known to stand anywhere before the first move, and after one that
    was not confirmed. A dial counts from 0° to 360°, so that whole turns are taken as the move went.

    Concurrency: `stop`, `make_safe`, and whatever asks a question of its own, withdraw the one that is open; whoever
    asked it then has Refused.
    """

    def __init__(self, setup: Setup[OperatorHeadOptions, OperatorHeadLimits, Nothing]) -> None:
        self.name = setup.name
        self._person, self._note, self._stated = setup.person, setup.note, setup.identity
        self._options, self._limits = setup.options, setup.limits
        self._latest: Latest[float] = Latest(setup.name, "move")  # its result is where the head stands
        self._question: asyncio.Timeout | None = None  # ends the one that is open, when it is moved to now

    async def __aenter__(self) -> Self:
        """Nothing is connected, and nobody is asked."""
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Withdraws what is asked; the head stays as it is."""
        self._new_order()

    async def identify(self) -> Identity:
        """As the bench file states it: a head without a wire tells nothing."""
        stated = self._stated
        return Identity(
            maker=stated.maker or "", model=stated.model or "", serial=stated.serial or "",
            firmware=stated.firmware or "", verified=False, fingerprint="turned by hand",
        )  # fmt: skip

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        """The angle that was typed; nothing while it is not known."""
        return {} if self._latest.result is None else {"angle": [self._reading(self._latest.result)]}

    async def angle(self) -> Reading:
        """The angle that was typed (°); somebody is asked for it where it is not known."""
        stands_deg = self._latest.result
        if stands_deg is None:
            order = self._new_order()
            stands_deg = await self._typed(order, self._errand(wording.to_look(self.name)))
            self._latest.done(order, stands_deg)
        return self._reading(stands_deg)

    async def move_to(self, angle_deg: float, *, approach: Approach, settle_s: float) -> Reading:
        """Has the head turned to `angle_deg`; the angle typed, after `settle_s` more.

        A head that stands there is left alone by a direct move. Raises BeyondLimit before anybody is asked; Refused
        when what is typed is off again and again, or when another command ends the move; NoAnswer when nobody answers.
        """
        self._check(angle_deg)
        order, stands_deg = self._latest.order, self._latest.result
        if stands_deg is None or approach != "direct" or abs(stands_deg - angle_deg) > self._options.tolerance:
            order = self._new_order()
            text = wording.to_turn(self.name, stands_deg, angle_deg, approach)
            stands_deg = await self._typed(order, self._errand(text, Turn(angle_deg, approach)))
            self._latest.done(order, stands_deg)
        await asyncio.sleep(settle_s)
        order.check()
        return self._reading(stands_deg)

    async def stop(self) -> None:
        """Withdraws the question that is open; a person lets go by himself."""
        self._new_order(keeping=self._latest.result)

    async def make_safe(self) -> None:
        """Withdraws the question that is open. A person cannot be made safe, and a head without a motor is."""
        self._new_order(keeping=self._latest.result)

    def _check(self, angle_deg: float) -> None:
        check_angle(self.name, "the angle", angle_deg, self._limits.angle)
        if not self._options.seats(angle_deg):
            raise BeyondLimit(
                self.name, f"the angle {angle_deg:g}° is between two teeth, which are {self._options.index_step:.9g}° "
                "apart", remedy="Nobody was asked. Correct the sequence, or options.index_step in the bench file.",
            )  # fmt: skip

    def _errand(self, text: str, turn: Turn | None = None) -> Errand:
        return Errand(self.name, text, "°", self._options.turn_time, self._options.give_up_after, turn)

    async def _typed(self, order: Order, errand: Errand) -> float:
        """Where the head stands, as soon as what is typed can be so."""
        told, asked_deg = errand.text, errand.turn.angle_deg if errand.turn is not None else None
        for _ in range(MOST_ANSWERS):
            answer = await self._ask(order, errand)
            stands_deg = answer.value
            if asked_deg is not None:
                stands_deg = asked_deg + math.remainder(answer.value - asked_deg, TURN_DEG)
            why = self._implausible(stands_deg, asked_deg)
            if not why:
                return stands_deg
            errand = errand._replace(text=wording.not_taken(answer.value, asked_deg, why, told), again=True)
        raise Refused(
            self.name, f"{MOST_ANSWERS} answers in a row cannot be; {why}", sent=told,
            received=wording.spelled(answer.value),
            remedy="Look at the head together with the sequence: its zero and dial, and options.index_step and "
            "options.tolerance in the bench file.",
        )  # fmt: skip

    def _implausible(self, stands_deg: float, asked_deg: float | None) -> str:
        """Why the head cannot stand at an angle; empty when it can."""
        most_deg = self._options.tolerance
        if asked_deg is not None and abs(stands_deg - asked_deg) > most_deg:
            return f"it is {stands_deg - asked_deg:+.6g}° off, at most ±{most_deg:g}° may be"
        if not self._options.seats(stands_deg):
            return f"it is between two teeth, which are {self._options.index_step:.9g}° apart"
        return ""

    async def _ask(self, order: Order, errand: Errand) -> Typed:
        """The answer; a question that has none is withdrawn, and the record says so."""
        order.check()
        question = self._question = asyncio.timeout(None)
        answered = False
        try:
            async with question:
                typed = await self._person.ask(errand)
                answered = True
                return typed
        except TimeoutError:
            if not question.expired():  # nobody has answered, which is a TimeoutError too
                raise
            raise order.refusal() from None
        finally:
            self._question = None
            if not answered:
                self._note(f"the question was withdrawn: {errand.text} Nobody has confirmed how the head stands.")

    def _new_order(self, keeping: float | None = None) -> Order:
        """Withdraws the question that is open; unless it is kept, nobody knows from now on how the head stands."""
        order = self._latest.begin()
        self._latest.result = keeping
        if self._question is not None and not self._question.expired():
            self._question.reschedule(asyncio.get_running_loop().time())
        return order

    def _reading(self, angle_deg: float) -> Reading:
        return Reading(asyncio.get_running_loop().time(), angle_deg)
