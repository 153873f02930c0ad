"""An indexing head turned by hand: the operator is prompted for each move and types the angle reached."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping, Sequence
from typing import Self

from drivers.certificates.corrections import TURN_DEG
from drivers.description import Nothing, Setup
from drivers.dialects.operator_head.description import OperatorHeadLimits, OperatorHeadOptions
from drivers.errors import BeyondLimit, Refused
from drivers.kinds.head.bounds import check_angle
from drivers.kinds.latest import Latest, Order
from drivers.person import OperatorAnswer, OperatorRequest, Turn
from drivers.recognised import as_stated
from drivers.values import Approach, Identity, Reading

MAX_ANSWERS = 5  # maximum answers to one move: after that, operator and sequence disagree
_COMING: dict[Approach, str] = {
    "direct": "", "from_below": ", coming to it from below", "from_above": ", coming to it from above",
}  # fmt: skip


class OperatorHead:
    """A head without a motor or a wire; a Positioner.

    Its angle is the last one typed; it is unknown before the first move, and after an unconfirmed one. A dial shows 0°
    to 360°, so whole turns are derived from the commanded move.

    Concurrency: `stop`, `make_safe` and every new prompt withdraw the open one, whose caller then gets Refused.
    """

    def __init__(self, setup: Setup[OperatorHeadOptions, OperatorHeadLimits, Nothing]) -> None:
        self.name = setup.name
        self._person, self._note, self._stated = setup.person, setup.note, setup.identity
        self._options, self._limits = setup.options, setup.limits
        self._latest: Latest[float] = Latest(setup.name, "move")  # its result is the angle of the head
        self._question: asyncio.Timeout | None = None  # ends the open prompt, for a move to the present angle

    async def __aenter__(self) -> Self:
        """Do nothing: there is no connection, and no prompt."""
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Withdraw an open prompt; the head stays as it is."""
        self._new_order()

    async def identify(self) -> Identity:
        """Identity stated in the bench file: a head without a wire reports none."""
        return as_stated(self._stated, "turned by hand")

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        """The angle that was typed; no reading while it is unknown."""
        return {} if self._latest.result is None else {"angle": [self._reading(self._latest.result)]}

    async def angle(self) -> Reading:
        """The angle that was typed (°); prompts for it if it is unknown."""
        present_deg = self._latest.result
        if present_deg is None:
            order = self._new_order()
            present_deg = await self._plausible_answer(order, self._request(angle_prompt(self.name)))
            self._latest.done(order, present_deg)
        return self._reading(present_deg)

    async def move_to(self, angle_deg: float, *, approach: Approach, settle_s: float) -> Reading:
        """Prompt for a turn to `angle_deg`; return the typed angle after a further `settle_s`.

        A direct move to the present angle prompts for nothing. Raises BeyondLimit before any prompt; Refused after
        repeated implausible answers, or if another command supersedes the move; NoAnswer without an answer.
        """
        self._check(angle_deg)
        order, present_deg = self._latest.order, self._latest.result
        if present_deg is None or approach != "direct" or abs(present_deg - angle_deg) > self._options.tolerance:
            order = self._new_order()
            text = move_prompt(self.name, present_deg, angle_deg, approach)
            present_deg = await self._plausible_answer(order, self._request(text, Turn(angle_deg, approach)))
            self._latest.done(order, present_deg)
        await asyncio.sleep(settle_s)
        order.check()
        return self._reading(present_deg)

    async def stop(self) -> None:
        """Withdraw the open prompt."""
        self._new_order(keeping=self._latest.result)

    async def make_safe(self) -> None:
        """Withdraw the open prompt; a head without a motor needs no more to be safe."""
        self._new_order(keeping=self._latest.result)

    def _check(self, angle_deg: float) -> None:
        check_angle(self.name, "the angle", angle_deg, self._limits.angle)
        if not self._options.is_index_position(angle_deg):
            raise BeyondLimit(
                self.name, f"the angle {angle_deg:g}° is between two teeth, which are {self._options.index_step:.9g}° "
                "apart", remedy="Nobody was asked. Correct the sequence, or options.index_step in the bench file.",
            )  # fmt: skip

    def _request(self, text: str, turn: Turn | None = None) -> OperatorRequest:
        return OperatorRequest(self.name, text, "°", self._options.turn_time, self._options.give_up_after, turn)

    async def _plausible_answer(self, order: Order, request: OperatorRequest) -> float:
        """Typed angle, once it is plausible."""
        prompt, requested_deg = request.text, request.turn.angle_deg if request.turn is not None else None
        for _ in range(MAX_ANSWERS):
            answer = await self._prompt(order, request)
            present_deg = answer.value
            if requested_deg is not None:
                present_deg = requested_deg + math.remainder(answer.value - requested_deg, TURN_DEG)
            why = self._implausible(present_deg, requested_deg)
            if not why:
                return present_deg
            request = request._replace(text=rejected(answer.value, requested_deg, why, prompt), again=True)
        raise Refused(
            self.name, f"{MAX_ANSWERS} answers in a row are impossible; {why}", sent=prompt,
            received=spelled(answer.value),
            remedy="Look at the head together with the sequence: its zero and dial, and options.index_step and "
            "options.tolerance in the bench file.",
        )  # fmt: skip

    def _implausible(self, present_deg: float, requested_deg: float | None) -> str:
        """Reason why the head cannot stand at an angle; empty if it can."""
        max_deg = self._options.tolerance
        if requested_deg is not None and abs(present_deg - requested_deg) > max_deg:
            return f"it is {present_deg - requested_deg:+.6g}° off, at most ±{max_deg:g}° may be"
        if not self._options.is_index_position(present_deg):
            return f"it is between two teeth, which are {self._options.index_step:.9g}° apart"
        return ""

    async def _prompt(self, order: Order, request: OperatorRequest) -> OperatorAnswer:
        """Prompt for an angle; a prompt without an answer is withdrawn and recorded."""
        order.check()
        question = self._question = asyncio.timeout(None)
        answered = False
        try:
            async with question:
                typed = await self._person.prompt(request)
                answered = True
                return typed
        except TimeoutError:
            if not question.expired():  # no answer, which is a TimeoutError too
                raise
            raise order.refusal() from None
        finally:
            self._question = None
            if not answered:
                self._note(f"the question was withdrawn: {request.text} The angle of the head is not confirmed.")

    def _new_order(self, keeping: float | None = None) -> Order:
        """Withdraw the open prompt; unless `keep`, the angle is unknown from now on."""
        order = self._latest.begin()
        self._latest.result = keeping
        if self._question is not None and not self._question.expired():
            self._question.reschedule(asyncio.get_running_loop().time())
        return order

    def _reading(self, angle_deg: float) -> Reading:
        return Reading(asyncio.get_running_loop().time(), angle_deg)


def spelled(angle_deg: float) -> str:
    """Format an angle as read off a dial; the last digit is 0.000001°."""
    return f"{round(angle_deg, 6) + 0.0:.12g}°"


def move_prompt(device: str, from_deg: float | None, to_deg: float, approach: Approach) -> str:
    """Prompt for a turn: target, start, direction, and final approach."""
    if from_deg is None:
        way = ""
    elif from_deg == to_deg:
        way = ", where it stands now" if approach == "direct" else ", where it stands now: away from it and back"
    else:
        start, turned = spelled(from_deg), spelled(abs(to_deg - from_deg))
        way = f", from {start} up by {turned}" if to_deg > from_deg else f", from {start} down by {turned}"
    return (
        f"Turn {device} by hand to {spelled(to_deg)}{way}{_COMING[approach]}. When it is there and "
        "locked, type the angle that it shows, in ° or deg."
    )


def angle_prompt(device: str) -> str:
    """Prompt for the angle of a head whose angle is unknown."""
    return f"Leave {device} as it is, and type the angle that it shows, in ° or deg."


def rejected(typed_deg: float, requested_deg: float | None, why: str, prompt: str) -> str:
    """Repeat a prompt after an implausible answer."""
    asked = f", {spelled(requested_deg)} was asked for" if requested_deg is not None else ""
    return f"{spelled(typed_deg)} was typed{asked}: {why}. {prompt}"
