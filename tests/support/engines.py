"""The engine on a simulated bench in virtual time, with a hand at its controls while it runs."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path

from bench.app.devices import open_devices
from bench.app.faults import FaultPlayer
from bench.app.laboratory import make_laboratory, unit_files
from bench.config.models import BenchFile
from bench.engine.ending import Outcome
from bench.engine.engine import Engine
from bench.engine.interlocks import Interlocks
from bench.engine.journal import Journal
from bench.engine.monitor import Monitor
from bench.engine.people import People
from bench.engine.state import RunState
from bench.loop import AS_FAST_AS_POSSIBLE, run
from bench.rig import Rig, limits_to_make_safe
from bench.runner.quiet import Quiet
from bench.sequence.plan.plan import Plan
from bench.store.reader import Event, RunReader, Series
from bench.store.writer import RunWriter
from drivers.can.frame_block import FrameBlock

SEED = 1
Script = Callable[[Engine], Awaitable[None]]


@dataclass(frozen=True)
class Ran:
    """A run that is over: how it ended, the state that the engine kept, what was shown, and its record.

    `moving` is whether the simulated axis still turns, `powered` whether a simulated unit still has its supply.
    """

    outcome: Outcome
    state: RunState
    notices: list[str]
    events: list[Event]
    frames: dict[str, dict[str, FrameBlock]]
    series: dict[str, Series]
    moving: bool
    powered: bool

    def steps(self, kind: str = "step_ended") -> list[str]:
        """The ids of the steps that entries of a kind are about, in their order."""
        return [event.step for event in self.events if event.kind == kind]

    def ended(self, step: str) -> Event:
        """The entry of a step that has ended."""
        return self._one("step_ended", step)

    def begun(self, step: str) -> Event:
        """The entry of a step that has begun."""
        return self._one("step_begins", step)

    def events_of(self, kind: str) -> list[Event]:
        """The entries of a kind."""
        return [event for event in self.events if event.kind == kind]

    def _one(self, kind: str, step: str) -> Event:
        (event,) = (event for event in self.events if (event.kind, event.step) == (kind, step))
        return event

    @property
    def made_safe(self) -> dict[str, str]:
        """The devices that could not be made safe, by the one entry that says so."""
        (event,) = (event for event in self.events if event.kind == "made_safe")
        unsafe: dict[str, str] = event.data["unsafe"]
        return unsafe


def run_plan(folder: Path, plan: Plan, bench: BenchFile, script: Script | None = None) -> Ran:
    """Run a plan; `script` is a task beside it, which ends with it."""
    folder.mkdir(parents=True)
    units = unit_files(bench, None)
    kept = []

    async def main() -> None:
        laboratory = make_laboratory(bench, units, SEED, asyncio.get_running_loop().time)
        FaultPlayer(laboratory, bench.simulation.faults, lambda _kind, _fault: None)
        writer, observer = RunWriter(folder), Quiet()
        try:
            people = People()
            async with Rig(open_devices(bench, laboratory, person=people), limits_to_make_safe(bench)) as rig:
                interlocks = Interlocks({**bench.interlocks, **plan.sequence.interlocks}, bench)
                journal = Journal(writer)
                monitor = Monitor(rig, bench, interlocks, journal, observer.reading)
                engine = Engine(plan, bench, rig, monitor, journal, observer)
                people.meet(engine.prompts, engine.journal, observer.notice)
                beside = asyncio.create_task(script(engine)) if script is not None else None
                outcome = await engine.run()
                if beside is not None:
                    beside.cancel()
                    await asyncio.wait([beside])
                    if not beside.cancelled():
                        beside.result()
        finally:
            writer.close()
        world = laboratory.world
        moving, powered = (
            world.axis.moving(world.now()),
            any(unit.powered_at_s is not None for unit in world.units.values()),
        )
        kept.append((outcome, engine.journal.state, observer.notices, moving, powered))

    run(main(), AS_FAST_AS_POSSIBLE)
    with RunReader(folder) as reader:
        series = {name: reader.series(name) for name in reader.channels()}
        ((outcome, state, notices, moving, powered),) = kept
        frames = reader.frames_by_step()
        return Ran(outcome, state, notices, list(reader.events()), frames, series, moving, powered)
