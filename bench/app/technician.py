"""A technician in software: answers the questions of a run on simulated instruments, and does what they ask for."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from bench.app.drawn import simulated_mount
from bench.config.answers import AnswersFile, ScriptedAnswer
from bench.config.document import Problem, read_document
from bench.config.load import load
from bench.config.models import BenchFile
from bench.engine.questions import Desk, Question
from bench.errors import InputError
from bench.sequence.dwells import first_visit
from bench.sequence.plan import Plan
from bench.sequence.talk import Prompt
from drivers.suggest import did_you_mean
from simulators.world import World

Script = Mapping[str, ScriptedAnswer]
USUAL = ScriptedAnswer()


def read_script(path: Path | None, plan: Plan, bench: BenchFile) -> Script:
    """The answers in a file, which fit the questions of the plan; InputError. Without a file there are none."""
    if path is None:
        return {}
    document = read_document(path)
    script = load(document, AnswersFile).answers
    if found := document.told(_misfits(script, plan, bench)):
        raise InputError(*found)
    return script


def _misfits(script: Script, plan: Plan, bench: BenchFile) -> Iterator[Problem]:
    prompts = {planned.id: planned.step for planned in plan if isinstance(planned.step, Prompt)}
    for step, given in script.items():
        base = _first_visit(step)
        if base.removesuffix("?") not in {planned.id for planned in plan}:
            yield ("answers", step), f"the plan has no step '{step}'{did_you_mean(step, prompts)}"
        elif base in prompts and given.answer is not None:
            try:
                _question(base, prompts[base]).read(given.answer)
            except InputError as problem:
                yield ("answers", step, "answer"), f"answer: {problem}"
        mount = given.does.mount if given.does else None
        if mount is not None and mount not in bench.fixture.mounts:
            hint = did_you_mean(mount, bench.fixture.mounts)
            yield ("answers", step, "does", "mount"), f"the fixture has no mount '{mount}'{hint}"


def unanswered(plan: Plan, script: Script) -> list[str]:
    """The steps that want something typed, which the script does not answer."""
    return [
        planned.id for planned in plan
        if isinstance(planned.step, Prompt) and planned.step.input is not None
        and (planned.id not in script or script[planned.id].answer is None)
    ]  # fmt: skip


class Technician:
    """Answers what is asked at a desk, each question after its time.

    Concurrency: a task for each question, which ends with the run's loop.
    """

    def __init__(
        self, desk: Desk, script: Script, bench: BenchFile, world: World | None, notice: Callable[[str], None]
    ) -> None:
        self._desk, self._script, self._bench, self._world, self._notice = desk, script, bench, world, notice
        self._tasks: set[asyncio.Task[None]] = set()
        desk.on_question = self.asked

    def asked(self, question: Question) -> None:
        """A question is open."""
        task = asyncio.create_task(self._serve(question), name=f"technician {question.step}")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _serve(self, question: Question) -> None:
        given = self._script.get(question.step) or self._script.get(_first_visit(question.step), USUAL)
        await asyncio.sleep(given.after)
        deed = given.does if given.does is not None else question.expect
        if deed is not None and self._world is not None:
            if deed.mount is not None:
                self._world.fix_units(simulated_mount(self._bench.fixture.mounts[deed.mount]))
            if deed.input is not None:
                self._world.connect(deed.input)
        answer = given.answer if given.answer is not None else next(iter(question.choices), "")
        if question in self._desk.questions:  # nobody was faster
            self._notice(f"{question.text}\n{given.by}: {answer}")
            self._desk.answer(answer, given.by, question.step)


def _first_visit(step: str) -> str:
    """The id of a step, also when it was begun again."""
    return first_visit(step) + ("?" if "~" in step and step.endswith("?") else "")


def _question(step: str, prompt: Prompt) -> Question:
    return Question(step, prompt.text, prompt.allowed, prompt.input)
