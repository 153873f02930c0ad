"""The rules that a plan is held against as a whole, once each of its steps is right by itself."""

from __future__ import annotations

from bench.config.models import BenchFile
from bench.sequence.checks_channel import no_ammeter, no_converter, source_unplugged, unsuited_ramp
from bench.sequence.checks_indexing import beyond_range, one_end
from bench.sequence.checks_ladder import incomplete_ladder, ladder_below_limit, no_nominal, step_below_band
from bench.sequence.checks_method import (
    soak_never_stable,
    too_few_angles,
    too_few_repetitions,
    too_few_temperatures,
    unsuited_unit,
)
from bench.sequence.checks_motion import forbidden_angle, short_acquisition, unreachable_attitude
from bench.sequence.checks_names import unused_need, unused_parameter
from bench.sequence.checks_range import beyond_unit_range
from bench.sequence.checks_safety import left_cold, left_energised, limit_below_window, no_teardown
from bench.sequence.checks_structure import shared_device, unreachable
from bench.sequence.checks_table import (
    commensurate_swing,
    incomplete_table_test,
    no_encoder,
    no_scale,
    too_few_pulses,
)
from bench.sequence.plan import Plan
from bench.sequence.remarks import Remark, Rule

RULES = (
    Rule("left-energised", "error", "every output is off after the teardown", left_energised),
    Rule("shared-device", "error", "branches done at the same time have devices of their own", shared_device),
    Rule("forbidden-angle", "error", "the head keeps away from what the fixture forbids", forbidden_angle),
    Rule("beyond-unit-range", "error", "no unit is taken beyond its range", beyond_unit_range),
    Rule("unreachable-attitude", "error", "the table reaches every attitude", unreachable_attitude),
    Rule("source-unplugged", "error", "a source is on only while it feeds the converter", source_unplugged),
    Rule("no-ammeter", "error", "where an ammeter is to be believed there is one", no_ammeter),
    Rule("no-converter", "error", "a channel has a converter whose temperature is read", no_converter),
    Rule("unsuited-unit", "error", "a method is for the units in the places", unsuited_unit),
    Rule("too-few-angles", "error", "a tumble has the angles that its constants need", too_few_angles),
    Rule("no-nominal", "error", "what a step lets expect is known", no_nominal),
    Rule("incomplete-ladder", "error", "a ladder has steps of both senses, between readings", incomplete_ladder),
    Rule("no-encoder", "error", "a test on a table has its encoder", no_encoder),
    Rule("no-scale", "error", "a test on a table knows the scale factor of the output", no_scale),
    Rule("incomplete-table-test", "error", "a test on a table has all its parts", incomplete_table_test),
    Rule("too-few-pulses", "warning", "an accelerometer gives many pulses or codes on a swing", too_few_pulses),
    Rule("too-few-temperatures", "warning", "a model over temperature has the degree asked for", too_few_temperatures),
    Rule("too-few-repetitions", "error", "a scatter has values enough", too_few_repetitions),
    Rule("unsuited-ramp", "warning", "a ramp for a channel is long and slow enough", unsuited_ramp),
    Rule("commensurate-swing", "warning", "samples see all phases of a swing", commensurate_swing),
    Rule("short-acquisition", "warning", "counting resolves what is asked for", short_acquisition),
    Rule("step-below-band", "warning", "the head can make the steps of a ladder", step_below_band),
    Rule("ladder-below-limit", "warning", "a ladder reaches beyond its limits", ladder_below_limit),
    Rule("one-end", "warning", "a calibration on an indexing table has both ends", one_end),
    Rule("beyond-range", "warning", "an indexing table stays within what the unit can read", beyond_range),
    Rule("unreachable", "warning", "every step can be done", unreachable),
    Rule("soak-never-stable", "warning", "a soak can become stable", soak_never_stable),
    Rule("no-teardown", "warning", "a teardown takes back what moved", no_teardown),
    Rule("left-cold", "warning", "the unit is not left colder than the room", left_cold),
    Rule("limit-below-window", "warning", "a unit that draws too much is noticed", limit_below_window),
    Rule("unused-parameter", "warning", "every parameter is used", unused_parameter),
    Rule("unused-need", "warning", "every need is used", unused_need),
)


def judge(plan: Plan, bench: BenchFile) -> tuple[Remark, ...]:
    """What the rules find in a plan without other problems, in the order of the file; each place once for each rule."""
    found = {
        (rule.name, place): Remark(rule.severity, rule.name, place, problem, advice)
        for rule in RULES
        for place, problem, advice in reversed(list(rule.find(plan, bench)))  # of many passes the first is kept
    }
    return tuple(sorted(found.values(), key=lambda remark: (plan.document.mark(remark.place), remark.rule)))
