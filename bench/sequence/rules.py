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
    Rule("left-energised", "error", "the teardown switches every output off", left_energised),
    Rule("shared-device", "error", "parallel branches use different devices", shared_device),
    Rule("forbidden-angle", "error", "the head avoids the forbidden angles of the fixture", forbidden_angle),
    Rule("beyond-unit-range", "error", "no unit is driven beyond its input range", beyond_unit_range),
    Rule("unreachable-attitude", "error", "the table reaches every attitude", unreachable_attitude),
    Rule("source-unplugged", "error", "a source is on only while it is connected to the converter", source_unplugged),
    Rule("no-ammeter", "error", "a bench has the ammeter that a method uses", no_ammeter),
    Rule("no-converter", "error", "the temperature of a channel's converter is measured", no_converter),
    Rule("unsuited-unit", "error", "a method suits the units in the places", unsuited_unit),
    Rule("too-few-angles", "error", "a tumble has the angles that determine its constants", too_few_angles),
    Rule("no-nominal", "error", "the nominal scale factor is known", no_nominal),
    Rule("incomplete-ladder", "error", "a ladder has steps in both directions, between readings", incomplete_ladder),
    Rule("no-encoder", "error", "a test on a table latches its encoder", no_encoder),
    Rule("no-scale", "error", "a test on a table knows the scale factor of the output", no_scale),
    Rule(
        "incomplete-table-test",
        "error",
        "a test on a table has every acquisition that its method needs",
        incomplete_table_test,
    ),
    Rule("too-few-pulses", "warning", "an accelerometer resolves the swing", too_few_pulses),
    Rule(
        "too-few-temperatures",
        "warning",
        "a model over temperature has enough temperatures for its degree",
        too_few_temperatures,
    ),
    Rule("too-few-repetitions", "error", "a standard deviation has enough repetitions", too_few_repetitions),
    Rule("unsuited-ramp", "warning", "a ramp for a channel is long enough and slow enough", unsuited_ramp),
    Rule("commensurate-swing", "warning", "the samples cover all phases of a swing", commensurate_swing),
    Rule("short-acquisition", "warning", "the counting time gives the resolution asked for", short_acquisition),
    Rule("step-below-band", "warning", "the head can resolve the steps of a ladder", step_below_band),
    Rule("ladder-below-limit", "warning", "a ladder reaches beyond its limits", ladder_below_limit),
    Rule("one-end", "warning", "a calibration on an indexing table has both orientations", one_end),
    Rule("beyond-range", "warning", "an indexing table stays within the unit's output limit", beyond_range),
    Rule("unreachable", "warning", "every step is reachable", unreachable),
    Rule("soak-never-stable", "warning", "a soak can become stable", soak_never_stable),
    Rule("no-teardown", "warning", "a teardown returns what was moved or heated", no_teardown),
    Rule("left-cold", "warning", "the unit is not left colder than the room", left_cold),
    Rule("limit-below-window", "warning", "an overcurrent of a unit is detected", limit_below_window),
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
