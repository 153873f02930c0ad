"""Kind `faults`: rehearsals of a sequence, each with other faults."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bench.app.inputs import digest_of, expect_inputs, inputs_of
from bench.app.rehearse import Rehearsal, rehearse
from bench.app.request import PreparedRun, RunRequest, prepare
from bench.campaign.isolation import isolate
from bench.campaign.program import ROOT
from bench.campaign.tasks import Known, Task
from bench.config.load import find, shipped
from bench.runner.quiet import Quiet
from bench.store.reader import digest_of as digest_of_run

PASS, BENCH_ERROR, NOT_SAFE = 0, 3, 6  # as in bench.cli.exits


@dataclass(frozen=True)
class Night:
    """A sequence on the simulators of a bench. `settings` are "NAME=VALUE"."""

    sequence: str
    bench: str
    preset: str | None = None
    settings: tuple[str, ...] = ()

    @property
    def request(self) -> RunRequest:
        """Request for its run, with all instruments simulated."""
        return RunRequest(
            self.sequence, self.bench, simulate=True, preset=self.preset, settings=self.settings, operator="campaign",
            past_due="mark", no_report=True,
        )  # fmt: skip

    @property
    def words(self) -> str:
        """Words of `bench rehearse` for it."""
        preset = f" --preset {self.preset}" if self.preset else ""
        return f"{self.sequence} --bench {self.bench}{preset}" + "".join(f" --set '{each}'" for each in self.settings)


def night_of(sequence: str, bench: str, preset: str | None, settings: Sequence[str]) -> Night:
    """Return a night; files that are not shipped by their absolute paths, since a worker has another folder."""
    return Night(_named(sequence, "sequences"), _named(bench, "config"), preset, tuple(settings))


def _named(name: str, kind: Any) -> str:
    path = find(name, kind).resolve()
    return path.stem if path.parent in [folder.resolve() for folder in shipped(kind)] else str(path)


class Faults:
    """Campaign of so many nights from a first seed. Raises InputError for a sequence or bench with errors."""

    name = "faults"

    def __init__(self, night: Night, seeds: range) -> None:
        self._night = night
        inputs = digest_of(inputs_of(prepare(night.request)))
        self._tasks = [
            Task(f"night {seed}", "bench.campaign.nights:play", {**asdict(night), "inputs": inputs, "seed": seed})
            for seed in seeds
        ]

    def tasks(self, known: Known) -> Sequence[Task]:
        """All nights."""
        return self._tasks

    def lines(self, known: Known, out: Path) -> Iterator[str]:
        """Lines: how the nights ended, and each that is not as it should be, with the command that plays it again."""
        ends, wrong = Counter[str](), 0
        for task in self._tasks:
            result = known(task)
            if result is None or not result.is_finished:
                continue
            ends[f"{result.content['ended']}, {result.content['verdict'] or 'no verdict'}"] += 1
            for problem in result.content["wrong"]:
                wrong += 1
                yield f"{task.key}: {problem}"
                yield f"  to play it again: bench rehearse {self._night.words} --faults {task.arguments['seed']}"
        yield from (f"{count} nights: {what}" for what, count in sorted(ends.items()))
        yield f"faults: {sum(ends.values())} nights, " + (f"{wrong} problems" if wrong else "each ended as it should")

    def exit_code(self, known: Known) -> int:
        """Return NOT_SAFE if a device was not made safe though nothing had broken it; an error for other problems."""
        found = [result.content for task in self._tasks if (result := known(task)) is not None and result.is_finished]
        if any(each["unsafe_without_fault"] for each in found):
            return NOT_SAFE
        return BENCH_ERROR if any(each["wrong"] for each in found) else PASS


def play(
    sequence: str, bench: str, preset: str | None, settings: Sequence[str], inputs: str, seed: int
) -> Mapping[str, Any]:
    """Rehearse a night with faults drawn by a seed; return how it ended and what is wrong with that.

    Raises InputError if the files are not those of the campaign.
    """
    with tempfile.TemporaryDirectory(dir=isolate()) as runs:
        request = Night(sequence, bench, preset, tuple(settings)).request
        prepared = prepare(request._replace(runs=Path(runs), inputs=inputs))
        expect_inputs(prepared)
        return _content(prepared, rehearse(prepared, Quiet(), seed))


def _content(prepared: PreparedRun, rehearsal: Rehearsal) -> Mapping[str, Any]:
    result = rehearsal.result
    return {
        "ended": result.outcome.how,
        "verdict": result.results.verdict if result.results is not None else None,
        "bench_s": result.bench_s,
        "planned_s": prepared.expected.total_s,
        "faults": [f"{fault.victim} {fault.kind}" for fault in rehearsal.faults],
        "problems": [problem.replace(f"{ROOT}/", "") for problem in result.problems],  # as on any computer
        "unsafe_without_fault": sorted(rehearsal.unsafe_without_fault),
        "wrong": [problem.replace(f"{ROOT}/", "") for problem in rehearsal.wrong],
        "digest": digest_of_run(result.path),
    }
