"""Runs over many seeds at the level of records: what one real run did to the world, done to the worlds of other seeds.

A run through all wires is noted once: every move, ramp and power-on with its time. The same is then done, at the same
times, to a world with other errors and another unit (`player.py` here). That takes seconds instead of minutes.
Units that pulse are replayed, on a head, a table of several axes or a rate table, and inertial units that send codes,
not voltages.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from multiprocessing import Pool
from pathlib import Path
from typing import Any, TypeVar
from unittest import mock

from bench.app.laboratory import Laboratory
from bench.app.request import RunRequest
from bench.app.truth import truth_of
from bench.config.bench import load_bench
from bench.config.models import BenchFile
from bench.metrology.run_data import RunData
from bench.reduce.evaluate import evaluate
from bench.reduce.journal import JournalRecords
from bench.reduce.stored_run import open_run
from bench.sequence.document.model import SequenceFile
from bench.sequence.method import known_methods
from campaigns.truth.campaign import run_one
from campaigns.truth.foreign import bench_errors
from campaigns.truth.player import Player, Stimulus, Template
from simulators.world import World

STIMULI = ("move", "turn", "swing", "change_swing", "stop", "ramp", "power", "fix_units", "connect")
Compared = TypeVar("Compared")


def template_of(request: RunRequest) -> Template:
    """Run a request through all wires, and notes what it does."""
    stimuli: list[Stimulus] = []
    origins_s: list[float] = []
    with _noting(stimuli, origins_s):
        path = run_one(request)
    with open_run(path) as stored:
        labels = dict.fromkeys(label for entry in stored.sequence.results for label in entry.labels)
        data = {label: _without_counts(stored.data(label)) for label in labels}
        return Template(path, origins_s[0], stimuli, stored.sequence, data)


def _without_counts(data: RunData) -> RunData:
    """Replace the counts by those of another seed, computed anew."""
    return replace(data, acquisitions=tuple(replace(each, counts={}) for each in data.acquisitions))


@contextmanager
def _noting(stimuli: list[Stimulus], origins_s: list[float]) -> Iterator[None]:
    def noted(name: str) -> Callable[..., None]:
        honest = getattr(World, name)

        def stimulate(world: World, *args: Any, **named: Any) -> None:
            origins_s.append(world._origin_s)
            stimuli.append(Stimulus(world._host_s(), name, args, named))
            honest(world, *args, **named)

        return stimulate

    with ExitStack() as stack:
        for name in STIMULI:
            stack.enter_context(mock.patch.object(World, name, noted(name)))
        yield


@dataclass(frozen=True)
class Replayed:
    """A run of another seed: its truth, and its results with the compensations of its calibration files."""

    truth: dict[str, Any]
    results: dict[str, Any]


def replayed(
    template: Template, bench: BenchFile, seed: int, uut_model: Path | None = None, form: str = "normal"
) -> Replayed:
    """The run of the template with everything drawn by another seed; `bench` may also state other uncertainties.

    The errors of the bench are drawn from distributions of a `form` (campaigns/truth/foreign.py).
    """
    with bench_errors(form):
        player = Player(template, bench, seed, uut_model, drifting=form == "drifting")
    data = player.play()
    truth = truth_of(_Stored(template.sequence, data), Laboratory(player.world, {}, {}))
    found = evaluate(template.sequence, data.__getitem__, "completed", JournalRecords())
    compensations = [each.to_json() for unit in found.units for each in unit.compensations]
    results = {**found.to_json(), "compensations": compensations}
    return Replayed(*(json.loads(json.dumps(each)) for each in (truth, results)))  # as files have them


def at_record_level(
    requests: Sequence[RunRequest], compared: Callable[[dict, dict], Compared], processes: int = 2
) -> list[Compared]:
    """Compare truths and results by `compared`; only the first goes through all wires."""
    template = template_of(requests[0])
    bench = load_bench(Path(requests[0].bench)).bench
    with Pool(processes) as pool:
        return pool.starmap(_compared, [(template, bench, each.seed, compared) for each in requests], chunksize=1)


def _compared(template: Template, bench: BenchFile, seed: int, compared: Callable[[dict, dict], Compared]) -> Compared:
    run = replayed(template, bench, seed)
    return compared(run.truth, run.results)


@dataclass(frozen=True)
class _Stored:
    """As much of a stored run as the truth asks for."""

    sequence: SequenceFile
    data: Mapping[str, RunData]

    def counted_at(self, what: str) -> list[RunData]:
        wanted = [each.labels for each in self.sequence.results if known_methods()[each.method].counts_at == what]
        return [self.data[label] for label in dict.fromkeys(label for labels in wanted for label in labels)]
