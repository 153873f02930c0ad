"""Step that decides during a run whether both ends of a unit on an indexing table must be measured again."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from bench.errors import StepError
from bench.methods.indexing.method import INDEXING_STATIC, CompareEndsSettings
from bench.methods.indexing.reduction.run import Attempt, attempts_of
from bench.reduce.stored_run import open_run
from bench.store.writer import RunWriter


class Running(Protocol):
    """Part of a run that the step uses."""

    @property
    def writer(self) -> RunWriter:
        """Writer of the run's record."""

    def notice(self, text: str) -> None:
        """Show the operator a text."""


async def compare_ends(settings: CompareEndsSettings, bench: Running) -> Mapping[str, Any]:
    """Return "accept", "repeat" or "marginal" as `value`, from all readings on the disk so far, and the `attempts`.

    It is "repeat" while there are no readings. The scale factors of both ends are compared as for the results, with the
    settings of `indexing_static` in the sequence.
    """
    await bench.writer.commit()
    loop = asyncio.get_running_loop()
    attempts = await loop.run_in_executor(None, _attempts, bench.writer.folder, settings.data)
    differ = [place for place, made in attempts.items() if not made or not made[-1].agrees]
    done = max((len(made) for made in attempts.values()), default=0)
    value = "accept" if not differ else "repeat" if done <= settings.max_repeats else "marginal"
    if value == "repeat" and done:
        bench.notice(f"Both ends of the unit in place {', '.join(differ)} differ by more than allowed: measure again.")
    return {"value": value, "attempts": done}


def _attempts(folder: Path, label: str) -> dict[str, Sequence[Attempt]]:
    """Attempts at both ends of each unit stored so far in a run; StepError without a result that uses them.

    Slow, to be called in its own thread.
    """
    with open_run(folder) as run:
        entry = next(
            (each for each in run.sequence.results if each.method == INDEXING_STATIC.name and each.data == label), None
        )
        if entry is None:
            raise StepError(f"no result of the sequence is {INDEXING_STATIC.name} of '{label}'; add one")
        wanted = INDEXING_STATIC.settings.model_validate(entry.settings).model_dump()
        data = run.data(label)
        return {unit.place: attempts_of(data, unit, wanted) for unit in data.units}
