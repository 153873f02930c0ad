"""Rules on a plan as a whole, applied once every single step is valid."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain

from bench.config.models import BenchFile
from bench.sequence.checks.motion import forbidden_angle, short_acquisition, unreachable_attitude
from bench.sequence.checks.names import unused_need, unused_parameter
from bench.sequence.checks.parts import missing_readings
from bench.sequence.checks.range import beyond_unit_range
from bench.sequence.checks.remarks import Remark, Rule
from bench.sequence.checks.safety import left_cold, left_energised, limit_below_window, no_teardown
from bench.sequence.checks.structure import shared_device, soak_never_stable, unreachable
from bench.sequence.checks.swings import commensurate_swing
from bench.sequence.checks.units import source_unplugged, unsuited_unit
from bench.sequence.method import MethodDescription, known_methods
from bench.sequence.plan.plan import Plan
from drivers.installed import loaded

GENERIC = (
    Rule("left-energised", "error", "the teardown switches every output off", left_energised),
    Rule("shared-device", "error", "parallel branches use different devices", shared_device),
    Rule("forbidden-angle", "error", "the head avoids the forbidden angles of the fixture", forbidden_angle),
    Rule("beyond-unit-range", "error", "no unit is driven beyond its input range", beyond_unit_range),
    Rule("unreachable-attitude", "error", "the table reaches every attitude", unreachable_attitude),
    Rule("source-unplugged", "error", "a source is on only while it is connected to the converter", source_unplugged),
    Rule("unsuited-unit", "error", "a method suits the units in the places", unsuited_unit),
    Rule("missing-readings", "warning", "every loop and group that a method knows is there by name", missing_readings),
    Rule("commensurate-swing", "warning", "the samples cover all phases of a swing", commensurate_swing),
    Rule("short-acquisition", "warning", "the counting time gives the resolution asked for", short_acquisition),
    Rule("unreachable", "warning", "every step is reachable", unreachable),
    Rule("soak-never-stable", "warning", "a soak can become stable", soak_never_stable),
    Rule("no-teardown", "warning", "a teardown returns the bench after moves and ramps", no_teardown),
    Rule("left-cold", "warning", "the unit is not left colder than the room", left_cold),
    Rule("limit-below-window", "warning", "an overcurrent of a unit is detected", limit_below_window),
    Rule("unused-parameter", "warning", "every parameter is used", unused_parameter),
    Rule("unused-need", "warning", "every need is used", unused_need),
)


def rules_of(methods: Iterable[MethodDescription]) -> tuple[Rule, ...]:
    """Rules that apply to every plan, and those of these methods."""
    targets = dict.fromkeys(method.rules for method in methods if method.rules)
    return (*GENERIC, *chain.from_iterable(loaded(target) for target in targets))


def every_rule() -> tuple[Rule, ...]:
    """Rules that apply to every plan, and those of all installed methods."""
    return rules_of(known_methods().values())


def judge(plan: Plan, bench: BenchFile) -> tuple[Remark, ...]:
    """Remarks of the rules on a plan without other problems, in file order; one for each place and rule."""
    found = {
        (rule.name, place): Remark(rule.severity, rule.name, place, problem, advice)
        for rule in rules_of(known_methods()[entry.method] for entry in plan.sequence.results)
        for place, problem, advice in reversed(list(rule.find(plan, bench)))  # of several passes the first is kept
    }
    return tuple(sorted(found.values(), key=lambda remark: (plan.document.mark(remark.place), remark.rule)))
