"""Rules on units in their places: suitability of the method, and connections of their converters."""

from __future__ import annotations

from collections.abc import Iterator

from bench.config.models import BenchFile
from bench.config.places import UNIT_KINDS
from bench.sequence.checks.remarks import Found
from bench.sequence.method import known_methods
from bench.sequence.plan.plan import Plan, PlannedStep
from bench.sequence.steps.stimulus import SetOutput
from bench.sequence.steps.talk import Prompt


def unsuited_unit(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A method for another kind of unit than a place has, or one that needs an entry missing in the bench file."""
    for index, entry in enumerate(plan.sequence.results):
        method = known_methods()[entry.method]
        for name, place in bench.places.items():
            if place.kind not in method.kinds:
                wanted = " and ".join(UNIT_KINDS[kind] for kind in method.kinds)
                one = "" if place.voltmeter is None else "; a voltmeter reads one channel, not six simultaneously"
                yield (
                    ("results", index, "method"),
                    f"{entry.method} is for {wanted}, place '{name}' is for {UNIT_KINDS[place.kind]}{one}",
                    "Choose another method, or a bench with the units that it is for",
                )
            elif (
                method.counts_at == "windows" and "gyro_x" in bench.sent_units(place) and bench.site.host_clock is None
            ):
                yield (
                    ("results", index, "method"),
                    f"{entry.method} compares gyros that send their rates with the table's rate, which is "
                    f"timed by the computer's clock; for place '{name}' the bench file does not state the "
                    "uncertainty of that clock",
                    "Add it under site, such as host_clock: {U: 4 ppm, k: 2} for a clock disciplined by NTP or PTP",
                )


def source_unplugged(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A source that is on while not connected to the converter, or while a prompt asks to change that."""
    sources = {place.source for place in bench.places.values() if place.source}
    at_levels = any(known_methods()[entry.method].counts_at == "levels" for entry in plan.sequence.results)
    if not at_levels and not any(_plugs(planned) == "source" for planned in plan):
        return  # the wiring of a bench may be permanent; such a sequence contains no prompt for it
    plugged_in, on = False, set[str]()
    for planned in plan:
        step, plugs = planned.step, _plugs(planned)
        if isinstance(step, SetOutput) and step.role in sources:
            on = on | {step.role} if step.output == "on" else on - {step.role}
            if step.output == "on" and not plugged_in:
                yield (
                    (*planned.place, "set"),
                    f"'{step.role}' is switched on while the accelerometer is connected to the converter",
                    "Prompt for it first, with the source off: - prompt: Disconnect the accelerometer and plug the "
                    "source in. "
                    "with expect: {input: source}",
                )
        if plugs is not None:
            for role in sorted(on):
                yield (
                    (*planned.place, "expect"),
                    f"'{role}' is on while a prompt asks to change the connection of the converter",
                    f"Add before it: - {{set: {role}, output: off}}",
                )
            plugged_in = plugs == "source"


def _plugs(planned: PlannedStep) -> str | None:
    """Input of the converters that a person is asked to connect in a step."""
    step = planned.step
    return step.expect.input if isinstance(step, Prompt) and step.expect is not None else None
