"""Questions to people: asked by steps, answered over the control socket, on the terminal or by a script."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from bench.errors import InputError, StepError
from bench.sequence.steps.talk import PhysicalChange, TypedInput
from drivers.person import OperatorRequest
from drivers.quantity.quantities import Quantity, parse
from drivers.quantity.units import QuantityError
from drivers.schema.suggest import did_you_mean


class Question(NamedTuple):
    """A question of a step: the answer is one of `choices` or, without them, free input.

    A request of a device, `request`, has its own id in `step`.
    """

    step: str
    text: str
    choices: tuple[str, ...] = ()
    input: TypedInput | None = None
    picture: Path | None = None
    expect: PhysicalChange | None = None
    request: OperatorRequest | None = None

    def read(self, answer: str) -> Quantity | str:
        """Parse an answer; the InputError describes the expected form."""
        answer = answer.strip()
        if self.input is None:
            if answer not in self.choices:
                raise InputError(f"'{answer}' is not a possible answer{did_you_mean(answer, self.choices)}")
            return answer
        return _typed(answer, self.input)

    @property
    def expected(self) -> str:
        """Description of the permitted answers."""
        if self.input is None:
            return ", ".join(self.choices)
        bounds = [
            f"{word} {bound}" for word, bound in (("from", self.input.min), ("to", self.input.max)) if bound is not None
        ]
        return " ".join([f"a value in {self.input.unit}" if self.input.unit else "a text", *bounds])


def _typed(answer: str, wanted: TypedInput) -> Quantity | str:
    if wanted.unit is None:
        if not answer or len(answer) > 500 or not answer.isprintable():
            raise InputError("expected a text of up to 500 printable characters")
        return answer
    try:
        value = parse(answer)
        value.to(wanted.unit)
    except QuantityError as problem:
        raise InputError(f"'{answer}': {problem}; expected a value in {wanted.unit}") from None
    for bad, words, bound in (
        (wanted.min is not None and value < wanted.min, "at least", wanted.min),
        (wanted.max is not None and value > wanted.max, "at most", wanted.max),
    ):
        if bad:
            raise InputError(f"is {value}, expected {words} {bound}")
    return value


class Answer(NamedTuple):
    """An answer and the name of the person."""

    value: Quantity | str
    by: str


class PromptQueue:
    """Open questions. `on_question` is called for each new one, `on_answer` for each answer."""

    def __init__(self, on_question: Callable[[Question], None]) -> None:
        self._open: dict[str, tuple[Question, asyncio.Future[Answer]]] = {}
        self.on_question = on_question
        self.on_answer: Callable[[Question, Answer], None] = lambda _question, _answer: None

    @property
    def questions(self) -> tuple[Question, ...]:
        """Open questions, the oldest first."""
        return tuple(question for question, _ in self._open.values())

    async def ask(self, question: Question, give_up_after_s: float) -> Answer:
        """Ask and return the answer; StepError if there is none in time."""
        future: asyncio.Future[Answer] = asyncio.get_running_loop().create_future()
        self._open[question.step] = (question, future)
        try:
            self.on_question(question)
            async with asyncio.timeout(give_up_after_s):
                return await future
        except TimeoutError:
            raise StepError(
                f"nobody has answered within {give_up_after_s / 60:g} min: {question.text!r}. "
                f"Answer with 'bench answer RUN ...', expected: {question.expected}"
            ) from None
        finally:
            del self._open[question.step]

    def answer(self, text: str, by: str, step: str | None = None) -> Question:
        """Accept an answer to the one open question, or to that of a step; InputError if it is not permitted."""
        if step is None and len(self._open) > 1:
            raise InputError(f"several questions are open; name the step with --step: {', '.join(self._open)}")
        if not self._open or (step is not None and step not in self._open):
            raise InputError("no question is open" if step is None else f"no question is open in step {step}")
        question, future = self._open[step] if step is not None else next(iter(self._open.values()))
        answer = Answer(question.read(text), by)
        if not future.done():
            self.on_answer(question, answer)
            future.set_result(answer)
        return question
