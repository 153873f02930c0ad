"""Simulated technician: answers the prompts of a run on simulated instruments, and acts on them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from bench.app.drawn import simulated_mount
from bench.app.laboratory import Laboratory
from bench.config.answers import AnswersFile, ScriptedAction, ScriptedAnswer
from bench.config.document import Problem, read_document
from bench.config.load import load
from bench.config.models import BenchFile
from bench.engine.questions import Answer, PromptQueue, Question
from bench.errors import InputError
from bench.sequence.plan.dwells import first_visit
from bench.sequence.plan.plan import Plan
from bench.sequence.steps.talk import PhysicalChange, Prompt, TypedInput
from drivers.person import OperatorRequest
from drivers.quantity.quantities import Quantity
from drivers.schema.suggest import did_you_mean

Script = Mapping[str, ScriptedAnswer]
USUAL = ScriptedAnswer()
USUALLY_S = 60.0  # default delay of an answer to the prompt of a step


def read_script(path: Path | None, plan: Plan, bench: BenchFile) -> Script:
    """Read the answers of a file and check them against the plan; without a file there are none. Raises InputError."""
    if path is None:
        return {}
    document = read_document(path)
    script = load(document, AnswersFile).answers
    if found := document.located(_misfits(script, plan, bench)):
        raise InputError(*found)
    return script


def _misfits(script: Script, plan: Plan, bench: BenchFile) -> Iterator[Problem]:
    prompts = {planned.id: planned.step for planned in plan if isinstance(planned.step, Prompt)}
    for step, given in script.items():
        base = _first_visit(step)
        if base.partition("#")[0] in bench.devices:
            yield from _device_misfits(step, given, bench)
            continue
        if base.removesuffix("?") not in {planned.id for planned in plan}:
            yield ("answers", step), f"the plan has no step '{step}'{did_you_mean(step, prompts)}"
        elif base in prompts and given.answer is not None:
            yield from _answer_misfits(step, given.answer, _question(base, prompts[base]))
        mount = given.does.mount if given.does else None
        if mount is not None and mount not in bench.fixture.mounts:
            hint = did_you_mean(mount, bench.fixture.mounts)
            yield ("answers", step, "does", "mount"), f"the fixture has no mount '{mount}'{hint}"
        if given.does is not None and given.does.turn is not None:
            yield (
                ("answers", step, "does", "turn"),
                "is for a head turned by hand, like 'head#3'",
            )


def _device_misfits(key: str, given: ScriptedAnswer, bench: BenchFile) -> Iterator[Problem]:
    """Yield the problems of an answer to the requests of a device, or to one: `head`, `head#3`, `head#3~2`."""
    device, numbered, number = _first_visit(key).partition("#")
    if not bench.devices[device].connection.is_person:
        scheme = bench.devices[device].connection.scheme
        yield ("answers", key), f"'{device}' asks no questions: it is connected by {scheme}"
    elif numbered and not number.isdecimal():
        yield ("answers", key), f"'{key}' is not a question of '{device}'; its questions are {device}#1, {device}#2, …"
    elif given.answer is not None:
        yield from _answer_misfits(key, given.answer, Question(key, "", input=TypedInput(unit="°")))
    for what in given.does.model_fields_set - {"turn"} if given.does else ():
        yield ("answers", key, "does", what), f"the answer to a head is an angle; {what} is for prompts of a sequence"


def _answer_misfits(key: str, answer: str, question: Question) -> Iterator[Problem]:
    try:
        question.read(answer)
    except InputError as problem:
        yield ("answers", key, "answer"), f"answer: {problem}"


def unanswered(plan: Plan, script: Script) -> list[str]:
    """Return the steps with a prompt for text that the script does not answer."""
    return [
        planned.id for planned in plan
        if isinstance(planned.step, Prompt) and planned.step.input is not None
        and (planned.id not in script or script[planned.id].answer is None)
    ]  # fmt: skip


class Technician:
    """Answer the questions of a desk, each after its delay, and act in the simulated laboratory.

    Without a script people answer, and the simulated head follows the angles they enter.

    Concurrency: a task for each question, which ends with the run's loop.
    """

    def __init__(
        self, prompts: PromptQueue, script: Script | None, bench: BenchFile, laboratory: Laboratory | None,
        notice: Callable[[str], None],
    ) -> None:  # fmt: skip
        self._prompts, self._script, self._bench, self._notice = prompts, script or {}, bench, notice
        self._world = laboratory.world if laboratory is not None else None
        self._by_hand = laboratory.by_hand if laboratory is not None else {}
        self._answering = ""  # prompt that the technician is answering
        self._tasks: set[asyncio.Task[None]] = set()
        prompts.on_answer = self.answered
        if script is not None:
            prompts.on_question = self.asked

    def asked(self, question: Question) -> None:
        """Answer a new question."""
        task = asyncio.create_task(self._serve(question), name=f"technician {question.step}")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def answered(self, question: Question, answer: Answer) -> None:
        """Turn the simulated head to the angle that a person has entered."""
        request = question.request
        if question.step == self._answering or request is None or request.turn is None:
            return
        if isinstance(answer.value, Quantity):
            self._by_hand[request.device].turn_to_dial(answer.value.to(request.unit), request.turn)

    async def _serve(self, question: Question) -> None:
        given, request = self._given(question), question.request
        usually_s = request.usual_s if request is not None else USUALLY_S
        await asyncio.sleep(given.after if given.after is not None else usually_s)
        if request is None:
            self._change(given.does if given.does is not None else question.expect)
            answer = next(iter(question.choices), "")
        elif question in self._prompts.questions and self._by_hand[request.device].attended:
            answer = self._turned(request, given.does)
        else:
            return
        answer = given.answer if given.answer is not None else answer
        if question in self._prompts.questions:  # no person was faster
            self._notice(f"{question.text}\n{given.by}: {answer}")
            self._answering = question.step
            self._prompts.answer(answer, given.by, question.step)
            self._answering = ""

    def _given(self, question: Question) -> ScriptedAnswer:
        """Return the scripted answer for a question, else for the first visit of its step, else for its device."""
        more_often = question.request.device if question.request is not None else _first_visit(question.step)
        return self._script.get(question.step) or self._script.get(more_often, USUAL)

    def _change(self, action: ScriptedAction | PhysicalChange | None) -> None:
        if action is None or self._world is None:
            return
        if action.mount is not None:
            self._world.fix_units(simulated_mount(self._bench.fixture.mounts[action.mount]))
        if action.input is not None:
            self._world.connect(action.input, action.fed_channel)

    def _turned(self, request: OperatorRequest, action: ScriptedAction | None) -> str:
        """Turn a head as requested or as scripted; return the angle to enter, by default the requested one."""
        head, asked = self._by_hand[request.device], request.turn
        if asked is None:
            return f"{head.shown_deg:.12g} {request.unit}"
        if action is None:
            head.turn(asked)
        elif action.turn is not None:
            head.turn(asked._replace(angle_deg=action.turn))
        return f"{asked.angle_deg:.12g} {request.unit}"


def _first_visit(step: str) -> str:
    """Return the id of a step without the suffix of a repetition."""
    return first_visit(step) + ("?" if "~" in step and step.endswith("?") else "")


def _question(step: str, prompt: Prompt) -> Question:
    return Question(step, prompt.text, prompt.allowed, prompt.input)
