"""Commands to a run: what is told is on the disk by then."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from bench.engine.journal import Journal
from bench.engine.pulse import Pulse
from bench.engine.questions import PromptQueue, Question
from bench.engine.state import replayed
from bench.errors import InputError, StoreError
from bench.runner.commands import commands_of
from bench.store.reader import RunReader
from bench.store.writer import RunWriter


def commands(writer: RunWriter, message: list[str], pulse: Pulse | None = None):
    journal = Journal(writer)
    prompts = PromptQueue(lambda _question: None)
    manual = SimpleNamespace(to_json=lambda: None)
    engine = SimpleNamespace(journal=journal, prompts=prompts, resume=lambda: None, holds=[], manual=manual)
    return engine, commands_of(engine, SimpleNamespace(newest=dict), message.append, can_pause=True, pulse=pulse)


def test_the_status_has_only_what_is_on_the_disk(tmp_path: Path) -> None:
    async def main() -> None:
        writer = RunWriter(tmp_path)
        engine, handlers = commands(writer, [])
        for number in range(32):
            engine.journal.write("step_begins", f"steps/{number}")
            engine.journal.write("step_ended", f"steps/{number}")
            reported = json.loads(await handlers["status"]({}))
            with RunReader(tmp_path) as reader:
                assert replayed(reader.events()).done == reported["done"] == number + 1
        writer.close()

    asyncio.run(main())


def test_what_was_commanded_and_answered_is_on_the_disk_with_who_did_it_and_is_told(tmp_path: Path) -> None:
    message: list[str] = []

    async def main() -> None:
        writer = RunWriter(tmp_path)
        engine, handlers = commands(writer, message)
        asked = asyncio.create_task(engine.prompts.ask(Question("steps/1", "Ready?", ("yes", "no")), 10.0))
        await asyncio.sleep(0)
        await handlers["answer"]({"answer": "yes", "by": "A. Person", "user": "anna"})
        await handlers["resume"]({"by": "anna", "user": "anna"})
        with RunReader(tmp_path) as reader:
            assert [event.data for event in reader.events("command")] == [
                {"command": "answer", "answer": "yes", "by": "A. Person", "user": "anna"},
                {"command": "resume", "by": "anna", "user": "anna"},
            ]
        assert (await asked).by == "A. Person"
        writer.close()

    asyncio.run(main())
    assert message == ["answer by A. Person: answered: Ready?", "resume by anna: the run continues"]


def test_a_full_disk_is_told_in_place_of_a_status(tmp_path: Path) -> None:
    class Full(RunWriter):
        async def commit(self) -> None:
            raise StoreError("the run store cannot write")

    async def main() -> None:
        writer = Full(tmp_path)
        _, handlers = commands(writer, [])
        with pytest.raises(
            InputError, match="the state of the run could not be written to the disk: the run store cannot write"
        ):
            await handlers["status"]({})
        writer.close()

    asyncio.run(main())


@pytest.mark.parametrize(("pulse", "expected"), [(None, "none"), (Pulse(), "none"), (Pulse(guardian="late"), "late")])
def test_the_status_says_whether_the_guardian_answers(tmp_path: Path, pulse: Pulse | None, expected: str) -> None:
    async def main() -> None:
        writer = RunWriter(tmp_path)
        _, handlers = commands(writer, [], pulse)
        assert json.loads(await handlers["status"]({}))["guardian"] == expected
        writer.close()

    asyncio.run(main())
