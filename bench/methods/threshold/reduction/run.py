"""Method M4d: threshold and resolution from ladders of small steps of the head (equations 6.7).

A ladder consists of the acquisitions at one value of the loop variable `position`; the loop variable `offset` is the
step, 0 or absent at the position itself. The steps are read-back angles. No pulses from a channel within its dead band
are a valid reading here, not a fault.

An error of the head common to both ends of a step cancels: its zero, its harmonics, the level. Its repeatability does
not, nor do the encoder errors of a small step, which no certificate states.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.methods.threshold.reduction.threshold import LadderRecord, LadderStep, Threshold, find_threshold
from bench.metrology.acquisition import Acquisition, Output
from bench.metrology.orientation import elevation_rad
from bench.metrology.outputs import mean_output
from bench.metrology.pulse_counts import RESOLUTION_COUNTS
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import LOWER_BOUND, Finding, UnitResult
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import RunData, UnitUnderTest

NAMES = {
    "threshold": "the smallest input step about 0 g that the output follows",
    "resolution": "the smallest input step about a biased input that the output follows",
}
ARCSEC_PER_RAD = 3600 * 180 / np.pi


@dataclass(frozen=True, slots=True)
class Ladder:
    """A ladder for the report; `arcsec_per_g` converts a step of input to one of the head."""

    position_deg: float
    quantity: str
    found: Threshold
    arcsec_per_g: float

    def step_arcsec(self, step: LadderStep) -> float:
        """Read-back step of the head, with its sense."""
        return step.input_g * self.arcsec_per_g


def reduce(data: RunData, settings: Mapping[str, Any]) -> list[UnitResult]:
    """Reduce a run to the threshold or the resolution of every unit at every position.

    `settings` has the input above which a position is biased.
    """
    return [_reduced(data, unit, settings["biased_above_g"]) for unit in data.units]


def _reduced(data: RunData, unit: UnitUnderTest, biased_above_g: float) -> UnitResult:
    ladders, findings = [], []
    left_out, flags = [], []
    if unit.nominal_per_g is None:
        return UnitResult(unit.place, unit.serial, (), (), ("all",), (Flag("nominal_unknown"),))
    for position, acquisitions in by_position(data).items():
        outputs = {each.step: mean_output(each, unit) for each in acquisitions}
        unusable = {step: problem for step, output in outputs.items() if (problem := _problem(output))}
        flags += [Flag(problem, at=step) for step, problem in unusable.items()]
        used = [each for each in acquisitions if each.step not in unusable]
        ladder = _ladder(position, used, outputs, data, unit, biased_above_g) if used else None
        if ladder is None or not ladder.found.steps:
            left_out.append(f"position={position:g}")
            flags.append(Flag("no_steps", at=f"position {position:g}"))
            continue
        ladders.append(ladder)
        findings.append(_finding(ladder, used, data, unit))
    return UnitResult(
        unit.place, unit.serial, tuple(findings), (), tuple(left_out), tuple(flags), detail=tuple(ladders)
    )


def by_position(data: RunData) -> dict[float, list[Acquisition]]:
    """Acquisitions of each ladder, by its position."""
    ladders: dict[float, list[Acquisition]] = {}
    for acquisition in data.acquisitions:
        ladders.setdefault(acquisition.loops.get("position", 0.0), []).append(acquisition)
    return ladders


def _problem(output: Output) -> str:
    """Reason why a reading cannot be used; empty if it can."""
    return next((problem for problem in output.problems if problem != "dead_band"), "")


def _ladder(
    position_deg: float,
    used: Sequence[Acquisition],
    outputs: Mapping[str, Output],
    data: RunData,
    unit: UnitUnderTest,
    biased_above_g: float,
) -> Ladder:
    scale = unit.nominal_per_g or np.nan
    angle_rad = np.array([elevation_rad(each, unit, data.bench) for each in used])
    offset = np.array([each.loops.get("offset", 0.0) for each in used])
    alone_g = np.array(
        [np.hypot(outputs[each.step].single_u, outputs[each.step].quantisation_u) for each in used]
    ) / abs(scale)
    repeatability_rad = np.radians(data.bench.head.repeatability_u_deg)
    record = LadderRecord(
        time_s=np.array([(each.begin_s + each.end_s) / 2 for each in used]),
        step=offset,
        input_g=np.sin(angle_rad),
        output_g=np.array([outputs[each.step].value for each in used]) / scale,
        u_g=np.hypot(alone_g, repeatability_rad * np.cos(angle_rad)),
        count_g=alone_g / RESOLUTION_COUNTS if unit.is_counted else np.zeros(len(used)),
    )
    at_rad = float(np.mean(angle_rad[offset == 0])) if (offset == 0).any() else float(np.mean(angle_rad))
    quantity = "resolution" if abs(np.sin(at_rad)) > biased_above_g else "threshold"
    return Ladder(position_deg, quantity, find_threshold(record), ARCSEC_PER_RAD / float(np.cos(at_rad)))


def _finding(ladder: Ladder, used: Sequence[Acquisition], data: RunData, unit: UnitUnderTest) -> Finding:
    found = ladder.found
    flags = [*found.flags, *({"at_most": ("at_most",), "more_than": (LOWER_BOUND,)}.get(found.relation, ()))]
    at = {
        "position_deg": ladder.position_deg,
        "above_g": found.low_g,
        "up_to_g": found.high_g if np.isfinite(found.high_g) else None,
    }
    value_g = found.low_g if found.relation == "more_than" else found.threshold_g
    steps, tail = (_common([each.step for each in used]),), f"/position={ladder.position_deg:g}"
    return data.subject(unit).finding(
        ladder.quantity, NAMES[ladder.quantity], value_g, "g", list(_budget(found)), at, steps, tail, tuple(flags)
    )


def _budget(found: Threshold) -> Iterator[BudgetLine]:
    """Budget: position between its steps, unless above all of them, and scatter of the deciding ones."""
    if found.relation != "more_than":
        yield BudgetLine("ladder: between two of its steps", "B", found.u_ladder_g)
    if found.dof and found.excess > 1:
        yield BudgetLine("readings: scatter of the repeats", "A", found.u_noise_g, found.dof)
    else:
        yield BudgetLine("readings: what each tells of itself, and the repeatability of the head", "B", found.u_noise_g)


def _common(steps: Sequence[str]) -> str:
    """Block of the run that contains all of these steps."""
    parts = [step.split("/") for step in steps]
    shared = [names[0] for names in zip(*parts, strict=False) if len(set(names)) == 1]
    return "/".join(shared)
