"""Credit for a repeated soak, proved from readings before a run is resumed."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from bench.app.request import PreparedRun
from bench.app.resume import Resumption
from bench.config.models import BenchFile
from bench.engine.credit import Chamber, NoCredit, held
from bench.engine.crediting import SoakCredit, SoakEvidence
from bench.engine.past import done_of, interrupted_steps, steps_to_restore
from bench.engine.soaked import Record, soaked
from bench.errors import error_message
from bench.sequence.steps.custom import Custom
from bench.sequence.steps.waits import Soak
from bench.store.followed import FOLLOWED, read_lines
from bench.store.reader import RunReader
from drivers.kinds.chamber.description import ChamberOptions, ChamberSafe


def credit_of(resumption: Resumption, prepared: PreparedRun, held_now: Collection[str]) -> SoakCredit | None:
    """Return the credit of the interrupted soak, or of the last one that is restored; None if there is none.

    `held_now` are the devices that a guardian has held until this run.
    """
    soaks = list(_soaks(resumption, prepared))
    if not soaks:
        return None
    try:
        return SoakCredit(soaks[-1], _proved(soaks[-1], resumption, prepared, held_now))
    except NoCredit as problem:
        return SoakCredit(soaks[-1], str(problem))
    except Exception as problem:  # noqa: BLE001  unreadable data prove nothing, and delay no run
        return SoakCredit(soaks[-1], error_message(problem) or type(problem).__name__)


def _soaks(resumption: Resumption, prepared: PreparedRun) -> Iterator[str]:
    """Yield the ids of the soaks that are repeated, the decisive one last."""
    nodes, past = (*prepared.plan.setup, *prepared.plan.steps), resumption.past
    for planned in (*steps_to_restore(done_of(nodes, past)), *interrupted_steps(nodes, past)):
        if isinstance(planned.step, Soak):
            yield planned.id


def _proved(step: str, resumption: Resumption, prepared: PreparedRun, held_now: Collection[str]) -> SoakEvidence:
    bench, run = prepared.loaded.bench, resumption.path
    if resumption.past.restarted:
        raise NoCredit(f"{', '.join(resumption.past.restarted)} is done again from its first step")
    chamber = _chamber(bench)
    if chamber.role not in held_now:
        raise NoCredit(f"{chamber.role} was not held until now")
    unknown = frozenset(planned.id for planned in prepared.plan if isinstance(planned.step, Custom))
    with RunReader(run) as reader:
        air, set_point = reader.series(chamber.air), reader.series(chamber.set_point)
    before = soaked(Record(resumption.entries, air, set_point, unknown, bench.members), step, chamber)
    return SoakEvidence(chamber, before, held(list(read_lines(run / FOLLOWED)), run.name, chamber, before))


def _chamber(bench: BenchFile) -> Chamber:
    """Return the only chamber of a bench, with the band by which the run itself judges its air."""
    chambers = [role for role, entry in bench.devices.items() if isinstance(entry.safe, ChamberSafe)]
    if len(chambers) != 1:
        raise NoCredit("the bench does not have one chamber")
    entry, names = bench.devices[chambers[0]], {reading.from_: name for name, reading in bench.readings.items()}
    if not isinstance(entry.options, ChamberOptions) or not isinstance(entry.safe, ChamberSafe):
        raise NoCredit(f"{chambers[0]} has no band for its air")
    sources = (f"{chambers[0]}.process_value", f"{chambers[0]}.set_point")
    air, set_point = (names.get(source, source) for source in sources)
    return Chamber(chambers[0], air, set_point, entry.options.follow.band, entry.safe.temperature)
