"""Rules on the state in which a run leaves bench and unit, and on the monitoring of the unit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from bench.config.models import BenchFile
from bench.sequence.checks.remarks import Found
from bench.sequence.plan.plan import Plan, PlannedStep
from bench.sequence.steps.orienting import Orient
from bench.sequence.steps.stimulus import Move, Oscillate, Ramp, Rotate, SetOutput

DRY_FROM_C = 15.0  # above the dew point of a laboratory


def left_energised(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """An output that is switched on and that the teardown does not switch off."""
    on: dict[str, PlannedStep] = {}
    for planned in plan:
        step = planned.step
        if isinstance(step, SetOutput) and step.output == "on":
            on.setdefault(step.role, planned)
        elif isinstance(step, SetOutput) and planned.phase == "teardown":
            on.pop(step.role, None)
    for role, planned in on.items():
        yield (
            (*planned.place, "set"),
            f"'{role}' is switched on here, but not switched off in the teardown",
            f"Add to the teardown: - {{set: {role}, output: off}}",
        )


def no_teardown(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """Steps that move or heat the bench, without a teardown that returns it."""
    for planned in plan if not plan.teardown else ():
        if isinstance(planned.step, (Move, Orient, Rotate, Oscillate, Ramp)):
            yield (
                planned.place,
                f"there is no teardown that takes {_named(planned.step)} back after the steps end or fail",
                "Add a teardown that returns the head to 0° and the chamber to room temperature",
            )
            return


def _named(step: Move | Orient | Rotate | Oscillate | Ramp) -> str:
    return "the table" if isinstance(step, Orient) else f"'{step.role}'"


def left_cold(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """A unit left colder than the room, so that water condenses on it."""
    last = next((planned for planned in reversed(tuple(plan)) if isinstance(planned.step, Ramp)), None)
    if last is not None and isinstance(last.step, Ramp) and last.step.temperature_c < DRY_FROM_C:
        yield (
            (*last.place, "to"),
            f"the last ramp goes to {last.step.temperature_c:g} °C; on a unit colder than the room water "
            "condenses when the door opens",
            f"End the teardown with a ramp to {DRY_FROM_C:g} °C or above",
        )


def limit_below_window(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A supply whose current limit is below the supply windows of its units, so that these never trip."""
    for planned in plan:
        step = planned.step
        if not isinstance(step, SetOutput) or step.current_limit_a is None:
            continue
        for supply in bench.members(step.role):
            fed = [name for name, unit in bench.places.items() if unit.supply == supply]
            most_a = bench.current_range(supply)[1]
            if not math.isfinite(most_a) or most_a <= step.current_limit_a:
                continue
            alone = len(fed) == 1
            units = f"the unit in place '{fed[0]}'" if alone else f"the units on it, in {_listed(fed)}, together"
            unseen = (
                "its supply window never detects that it draws"
                if alone
                else "their supply windows never detect that they draw"
            )
            yield (
                (*planned.place, "current_limit"),
                f"the supply stops at {step.current_limit_a:g} A, {units} may draw {most_a:g} A, so that {unseen} "
                "too much",
                f"Give a current_limit of at least {most_a:g} A, or lower "
                f"places.{fed[0]}.supply_current.max of the bench file",
            )


def _listed(places: Sequence[str]) -> str:
    return "places " + ", ".join(f"'{name}'" for name in places[:-1]) + f" and '{places[-1]}'"
