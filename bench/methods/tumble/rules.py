"""Rules on the acquisitions that the results of a tumble need."""

from __future__ import annotations

import math
from collections.abc import Iterator

from bench.config.models import BenchFile
from bench.sequence.checks.acquired import results_by
from bench.sequence.checks.parts import unnumbered
from bench.sequence.checks.remarks import Found, Rule
from bench.sequence.plan.dwells import DwellNames
from bench.sequence.plan.plan import Plan
from bench.sequence.plan.poses import first_input_deg, poses_before
from bench.sequence.steps.measuring import Acquire
from bench.sequence.steps.stimulus import Move, Ramp

TUMBLE, REPEATABILITY, VERIFICATION = "temperature_tumble", "repeatability", "verify_compensation"
TUMBLE_ANGLES = 4  # for K0, K1, K2 and the misalignment: equations 1.5
CONSTANTS = {"c0": "K0", "K1": "K1", "d·K1": "misalignment", "c2": "K2"}  # by the terms of a tumble
LEAST_REPETITIONS = 3
FURTHER = ("K3", "Kip", "Kio", "asymmetry", "misalignment_y")  # terms that need eight angles or more, or a second mount
OF_SECOND_MOUNT = {"Kio", "misalignment_y"}
EVENLY, SAME_GAP_DEG = 8, 0.1
CLOCKED = 0.5  # sine of the roll of a mount beyond which the output axis is in the plane of the tumble
SAME_ANGLE_DIGITS = 3  # decimals of equal angles in °
OVER_TEMPERATURE = ("/temperature_coefficient", "T1", "T2", "/hysteresis", "/model_residual")

Position = tuple[float, bool]  # angle of the head, and True for a unit rotated by 90° about its input axis
Dwells = dict[str, tuple[float | None, list[Position]]]


def too_few_angles(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A tumble whose angles cannot separate its four constants."""
    for place, entry in results_by(plan, TUMBLE, REPEATABILITY, VERIFICATION):
        dwells, every = _dwells(plan, bench, entry.data), set[Position]()
        for dwell, (_, positions) in dwells.items():
            here = {(round(angle_deg, SAME_ANGLE_DIGITS) % 360, clocked) for angle_deg, clocked in positions}
            distinct, every = sorted({angle_deg for angle_deg, _ in here}), every | here
            if len(distinct) < TUMBLE_ANGLES:
                yield (
                    (*place, "data"),
                    f"a tumble needs at least {TUMBLE_ANGLES} distinct angles, '{entry.data}' has {len(distinct)} in "
                    f"{dwell}: {_inseparable(distinct, bench)}",
                    "Acquire near 0°, 90°, 180° and 270° at every temperature",
                )
                return  # the other dwells are likely to have the same problem
        if missing := _not_separated(sorted(every), [name for name in entry.limits if name in FURTHER], bench):
            yield (
                (*place, "limits", missing[0]),
                f"the {len(every)} angles of '{entry.data}' cannot determine {' and '.join(missing)}",
                "Acquire in a second mount too, rotated by 90° about the input axis, or remove the limit"
                if OF_SECOND_MOUNT.issuperset(missing)
                else "Acquire at eight angles or more, evenly over a turn, or remove the limit",
            )


def _not_separated(positions: list[Position], wanted: list[str], bench: BenchFile) -> list[str]:
    """Further terms with limits that these positions of a run cannot determine."""
    if not wanted:
        return []
    by_mount = [[angle for angle, clocked in positions if clocked == mount] for mount in (False, True)]
    if all(_evenly(angles_deg) for angles_deg in by_mount if angles_deg):  # the usual case
        without = [{"Kip"}, OF_SECOND_MOUNT]
        missing = set[str]().union(*(names for names, at in zip(without, by_mount, strict=True) if not at))
        return [name for name in wanted if name in missing]
    import numpy as np  # only if limits name them, so that a check does not import numpy

    from bench.methods.tumble.reduction.solution import further_terms

    angle_rad = np.radians([first_input_deg(angle_deg, bench) for angle_deg, _ in positions])
    clocked = np.array([each for _, each in positions], dtype=np.bool_)
    found = (*further_terms(angle_rad, clocked), *(["misalignment_y"] if clocked.any() else []))
    return [name for name in wanted if name not in found]


def _evenly(angles_deg: list[float]) -> bool:
    """True for eight angles or more, evenly over a turn, which determine all further terms of their mount."""
    apart = [after - before for before, after in zip(angles_deg, [*angles_deg[1:], angles_deg[0] + 360], strict=True)]
    return len(apart) >= EVENLY and max(apart) - min(apart) < SAME_GAP_DEG


def _inseparable(angles_deg: list[float], bench: BenchFile) -> str:
    """Coefficients that cannot be separated, by the arithmetic of the reduction."""
    import numpy as np  # only if a sequence has this problem, so that a check does not import numpy

    from bench.methods.tumble.reduction.solution import IncompleteTumble, solve_tumble

    try:
        solve_tumble(np.radians([first_input_deg(each, bench) for each in angles_deg]), np.zeros(len(angles_deg)))
    except IncompleteTumble as problem:
        names = [CONSTANTS[name] for name in problem.names]
        return f"{', '.join(names[:-1])} and {names[-1]} cannot be separated"
    raise AssertionError("fewer readings than constants determined them")


def too_few_temperatures(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """Fewer temperatures than the degree of a model needs; one alone is reported only if a limit needs more."""
    for place, entry in results_by(plan, TUMBLE):
        from bench.methods.tumble.method import TemperatureTumbleSettings  # imported only if a sequence uses the method

        degree = TemperatureTumbleSettings.model_validate(entry.settings).degree
        temperatures = {round(set_c, 6) for set_c, _ in _dwells(plan, bench, entry.data).values() if set_c is not None}
        judged = any(name.endswith(OVER_TEMPERATURE) for name in entry.limits)
        if len(temperatures) <= degree and (len(temperatures) > 1 or judged):
            found = max(len(temperatures), 1)
            gives = f"a model of degree {found - 1}" if found > 1 else "no model over temperature"
            yield (
                (*place, "settings", "degree"),
                f"a model of degree {degree} needs {degree + 1} temperatures; {found} give{'s' if found == 1 else ''} "
                f"{gives}",
                f"Measure at {degree + 1} temperatures, or "
                + (f"write settings: {{degree: {found - 1}}}" if found > 1 else "drop the limits over temperature"),
            )


def too_few_repetitions(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """Fewer tumbles than a standard deviation needs."""
    for place, entry in results_by(plan, REPEATABILITY):
        if (count := len(_dwells(plan, bench, entry.data))) < LEAST_REPETITIONS:
            yield (
                (*place, "data"),
                f"the scatter of '{entry.data}' needs at least {LEAST_REPETITIONS} tumbles, the plan has {count}",
                "Repeat the tumble, in a loop directly around the loop over the positions",
            )


def unnumbered_cycles(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A set point reached again from the same side outside a loop 'cycle': its visits count as one cycle."""
    for place, entry in results_by(plan, TUMBLE):
        visits, before_c = [], math.nan
        for dwell, (set_c, _) in _dwells(plan, bench, entry.data).items():
            if set_c is not None and not math.isnan(before_c):  # the side of approach of the first one is unknown
                visits.append((f"{dwell}/", (round(set_c, 6), set_c > before_c)))
            before_c = math.nan if set_c is None else set_c
        if again := list(unnumbered(visits, "cycle")):
            yield (
                (*place, "data"),
                f"'{entry.data}' reaches the temperature of {again[0].rstrip('/')} again from the same side, outside a "
                "loop 'cycle': hysteresis is taken between the first visits only",
                "Put the cycles in a loop: for_each: cycle, in: {from: 1, to: 2}",
            )


def _dwells(plan: Plan, bench: BenchFile, label: str) -> Dwells:
    """Set point and positions of the acquisitions under a label, by dwells as in the record of a run."""
    angle_deg, set_c = 0.0, math.nan
    names = DwellNames()
    dwells: Dwells = {}
    for planned, pose in poses_before(plan, None):
        match planned.step:
            case Move():
                angle_deg = planned.step.target_deg(pose.angles_deg.get(planned.step.role, 0.0))
            case Ramp():
                set_c = planned.step.temperature_c
                names.ramped(planned.id)
            case Acquire() if planned.step.label == label:
                first = None if math.isnan(set_c) else set_c
                is_known = pose.mount is None or pose.mount in bench.fixture.mounts
                roll_deg = bench.fixture.mount(pose.mount).roll if is_known else 0.0
                position = angle_deg, abs(math.sin(math.radians(roll_deg))) > CLOCKED
                dwells.setdefault(names.of(planned.id), (first, []))[1].append(position)
    return dwells


RULES = (
    Rule("too-few-angles", "error", "a tumble has the angles that determine its constants", too_few_angles),
    Rule(
        "too-few-temperatures",
        "warning",
        "a model over temperature has enough temperatures for its degree",
        too_few_temperatures,
    ),
    Rule("unnumbered-cycles", "warning", "cycles of a tumble over temperature are numbered", unnumbered_cycles),
    Rule("too-few-repetitions", "error", "a standard deviation has enough repetitions", too_few_repetitions),
)
