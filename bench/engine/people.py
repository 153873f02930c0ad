"""Questions to people with their own journal entries, including requests of devices during a run."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable
from typing import Any

from bench.engine.journal import Journal
from bench.engine.questions import Answer, PromptQueue, Question
from bench.errors import StepError
from bench.sequence.steps.talk import TypedInput
from drivers.errors import NoAnswer
from drivers.person import NO_OPERATOR, OperatorAnswer, OperatorRequest, Person
from drivers.quantity.quantities import Quantity


async def answered(
    prompts: PromptQueue, journal: Journal, question: Question, give_up_after_s: float, /, **facts: Any
) -> Answer:
    """Return the answer; question and outcome are written to the journal, with `facts` beside the answer."""
    journal.write("asked", question.step, text=question.text, expected=question.expected)
    try:
        answer = await prompts.ask(question, give_up_after_s)
    except BaseException:
        journal.try_to_write("unanswered", question.step)
        raise
    journal.write("answered", question.step, answer=str(answer.value), by=answer.by, **facts)
    return answer


class People:
    """The operator as seen by devices: a Person, available during a run.

    The questions of a device are `ROLE#1`, `ROLE#2`, … in their order; one repeated after an invalid
    answer has the suffix `~2`, `~3`, …, as a repeated step.
    """

    def __init__(self) -> None:
        self._person: Person = NO_OPERATOR

    def meet(self, prompts: PromptQueue, journal: Journal, notice: Callable[[str], None]) -> None:
        """Connect to a desk; withdrawn questions are passed to `notice`."""
        self._person = _PromptingPerson(prompts, journal, notice)

    async def prompt(self, request: OperatorRequest) -> OperatorAnswer:
        """Return the answer. Raise NoAnswer if there is none in time, CannotConnect before a run has started."""
        return await self._person.prompt(request)


class _PromptingPerson:
    def __init__(self, prompts: PromptQueue, journal: Journal, notice: Callable[[str], None]) -> None:
        self._prompts, self._journal, self._notice = prompts, journal, notice
        self._requests: Counter[str] = Counter()
        self._times: Counter[str] = Counter()

    async def prompt(self, request: OperatorRequest) -> OperatorAnswer:
        question = Question(self._id(request), request.text, input=TypedInput(unit=request.unit), request=request)
        facts = {"device": request.device, "question": request.text}
        try:
            answer = await answered(self._prompts, self._journal, question, request.give_up_s, **facts)
        except StepError as problem:
            raise NoAnswer(request.device, str(problem)) from problem
        except asyncio.CancelledError:
            self._notice(f"No longer needed: {request.text}")
            raise
        if not isinstance(answer.value, Quantity):
            raise TypeError(f"{question.step}: {answer.value!r} has no unit")
        return OperatorAnswer(answer.value.to(request.unit), answer.by)

    def _id(self, request: OperatorRequest) -> str:
        if not request.again:
            self._requests[request.device] += 1
        name = f"{request.device}#{self._requests[request.device]}"
        self._times[name] += 1
        return name if self._times[name] == 1 else f"{name}~{self._times[name]}"
