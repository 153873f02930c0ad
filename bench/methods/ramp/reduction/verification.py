"""Verification of a released calibration out of sample, on a new ramp: what it leaves of bias and scale factor (6.4).

The output is converted by the curves of the calibration (static), and by its dynamic model if it has one, with dT/dt of
the new ramp. A ramp does not separate the bias from the misalignment and from the zero of the head, both of which are
constant: the remaining error is judged about its mean over the run, as for a tilt meter that is zeroed once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.methods.ramp.reduction.left import Left, LeftErrors, LeftOnRamp, PartOfRamp
from bench.methods.ramp.reduction.pair import tilt_on_ramp
from bench.methods.ramp.reduction.run import parts_of
from bench.metrology.common_errors import level_drift, thermometer_errors
from bench.metrology.largest import largest_of
from bench.metrology.least_squares import Array, NotDetermined
from bench.metrology.results.budget import BudgetLine, common
from bench.metrology.results.finding import Finding, Subject, UnitResult
from bench.metrology.results.flag import Flag, samples_left_out
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.metrology.tilt_findings import TiltOrigin, span_finding
from bench.metrology.tilt_pair import with_pairs

LAG = "lag behind the thermometer, and the unit's response to the rate: contained"
MISALIGNMENT = "misalignment: contained"
OF_DYNAMIC = "_dynamic"


def reduce(data: RunData, settings: Mapping[str, Any]) -> list[UnitResult]:
    """Reduce a run to what the released calibration of every unit leaves on its legs at 0 g and at 1 g.

    Results of a pair that measures a tilt together are among those of its first unit.
    """
    return with_pairs(data, [_reduced(data, unit, settings) for unit in data.units], tilt_on_ramp)


def _reduced(data: RunData, unit: UnitUnderTest, settings: Mapping[str, Any]) -> tuple[UnitResult, LeftOnRamp | None]:
    level, upright, left_out, flags = parts_of(data, unit, settings["sample_s"])
    released = unit.released
    known = None if released is None else released.of_output(unit.output_unit)
    if released is None or known is None:
        flags.append(Flag("not_given", of="calibration"))
    if released is None or known is None or not level or not upright:
        return UnitResult(unit.place, unit.serial, (), (), left_out, tuple(flags)), None
    at_0g, at_1g = PartOfRamp.of(level), PartOfRamp.of(upright)
    if count := at_0g.excluded + at_1g.excluded:
        flags.append(samples_left_out("thermometer", count))
    of = LeftOnRamp(at_0g, at_1g, known, released.local_g(data.bench.gravity_mps2))
    try:
        left = of.left(LeftErrors())
    except NotDetermined:
        flags.append(Flag("ill_conditioned", of="K0"))
        return UnitResult(unit.place, unit.serial, (), (), left_out, tuple(flags)), None
    flags += [Flag("calibration:no_dynamic_model")] if known.dynamic is None else []
    flags += [Flag("calibration:samples_extrapolated")] if of.is_extrapolated else []
    flags += [Flag("calibration:faster")] if of.is_faster else []
    steps = {"K0": tuple(leg.step for leg in level), "K1": tuple(leg.step for leg in (*level, *upright))}
    findings = VerificationOnRamp(data, unit, of, left, steps).findings()
    return UnitResult(
        unit.place, unit.serial, tuple(findings), (), left_out, tuple(dict.fromkeys(flags)), detail=LeftCurves(of, left)
    ), of


@dataclass(frozen=True, slots=True)
class LeftCurves:
    """What is left on the legs of a ramp, for a report."""

    of: LeftOnRamp
    left: Left


@dataclass(frozen=True)
class VerificationOnRamp:
    """Findings of one unit: what is `left` on its legs, and the `steps` of the run that it is from."""

    data: RunData
    unit: UnitUnderTest
    of: LeftOnRamp
    left: Left
    steps: Mapping[str, tuple[str, ...]]

    def findings(self) -> Iterator[Finding]:
        """Largest bias that is left and its mean, largest scale factor, and spans of tilt; static, then dynamic."""
        changes = dict(self._changes())
        yield self._mean(changes)
        yield self._largest("K0/left_largest", "largest bias that the calibration leaves, about its mean",
                            self.left.static, "g", changes)  # fmt: skip
        name = "largest bias that its dynamic model leaves, about its mean"
        yield self._largest("K0/left_largest" + OF_DYNAMIC, name, self.left.dynamic, "g", changes)
        yield self._largest("K1/left_largest", "largest relative scale factor that it leaves, about its mean",
                            self.left.scale, "1", changes)  # fmt: skip
        for quantity, values in self._tilts():
            yield from self._span(quantity, values, changes)

    @property
    def _subject(self) -> Subject:
        return self.data.subject(self.unit)

    def _steps(self, quantity: str) -> tuple[str, ...]:
        return self.steps["K1" if quantity.startswith("K1") else "K0"]

    def _tilts(self) -> Iterator[tuple[str, Sequence[Array]]]:
        yield "tilt/uncompensated", self.left.uncompensated
        yield "tilt/verified", self.left.static
        yield "tilt/verified" + OF_DYNAMIC, self.left.dynamic

    # Errors that all samples have in common

    def _changes(self) -> Iterator[tuple[BudgetLine, tuple[Mapping[str, float], ...]]]:
        """Sources of uncertainty, and the figures with each error added and subtracted."""
        sources = [(line, LeftErrors(error)) for line, error in thermometer_errors(self.data, self.unit.temperature)]
        tilted, level_rad = level_drift(self.data)
        for line, errors in [*sources, (tilted, LeftErrors(level_rad=lambda at_s, _: level_rad(at_s)))]:
            yield line, tuple(_figures(self.of.left(errors.times(sign))) for sign in (1.0, -1.0))

    def _common(self, quantity: str, changes: Mapping[BudgetLine, tuple[Mapping[str, float], ...]]) -> list[BudgetLine]:
        """Contributions to a figure of errors that all samples have in common."""
        found = _figures(self.left)[quantity]
        return [
            BudgetLine(line.source, line.type, max(abs(each[quantity] - found) for each in changed), None, line.shared)
            for line, changed in changes.items()
        ]

    # Findings

    def _mean(self, changes: Mapping[BudgetLine, tuple[Mapping[str, float], ...]]) -> Finding:
        """Mean of the bias that is left, with the misalignment and all that is constant."""
        bench, quantity = self.data.bench, "K0/left_mean"
        level = abs(math.cos(self.of.level.angle_rad))
        head, values = bench.head, np.concatenate(self.left.static)
        sd_g = self.of.scatter_u(self.left.static, self.of.level)
        lines = [
            *self._common(quantity, changes),
            common("head: zero", math.radians(head.zero_u_deg) * level),
            common("head: harmonics", math.radians(math.hypot(*head.harmonics_u_deg)) * level),
            BudgetLine("head: repeatability", "B", math.radians(head.repeatability_u_deg) * level),
            bench.level.times(level),
            BudgetLine("samples: scatter", "A", sd_g / math.sqrt(len(values))),
            BudgetLine(MISALIGNMENT, "alias", 0.0),
        ]
        name = "mean of the bias that the calibration leaves, with the misalignment"
        return self._subject.finding(quantity, name, float(np.mean(values)), "g", lines, {}, self._steps(quantity))

    def _largest(
        self, quantity: str, name: str, left: Sequence[Array], unit: str,
        changes: Mapping[BudgetLine, tuple[Mapping[str, float], ...]],
    ) -> Finding:  # fmt: skip
        part = self.of.upright if quantity.startswith("K1") else self.of.level
        mean, sd = float(np.mean(np.concatenate(left))), self.of.scatter_u(left, part)
        about = [values - mean for values in left]
        largest = largest_of(about, [np.full(len(values), sd) for values in about])
        lines = self._common(quantity, changes)
        if quantity.startswith("K1"):
            u = math.sqrt(
                max(self.left.bias_left**2 - self.of.scatter_u(self.left.static, self.of.level) ** 2, 0.0)
            ) / abs(self.of.lifted_g)
            lines.append(BudgetLine("bias: its change between the 0 g part and the 1 g part", "B", u))
        interval = largest.interval.beside(math.hypot(*(line.u for line in lines)))
        worst = max(range(len(about)), key=lambda index: float(np.max(np.abs(about[index]), initial=0.0)))
        at_c = part.legs[worst].temperature_c[int(np.argmax(np.abs(about[worst])))]
        at = {"cycle": part.legs[worst].cycle, "leg": part.legs[worst].name, "at_c": float(at_c)}
        return self._subject.finding(
            quantity, name, largest.value, unit, [*largest.lines, *lines, BudgetLine(LAG, "alias", 0.0)], at,
            self._steps(quantity), interval=interval,
        )  # fmt: skip

    def _span(
        self, quantity: str, left: Sequence[Array], changes: Mapping[BudgetLine, tuple[Mapping[str, float], ...]]
    ) -> Iterator[Finding]:
        origin = TiltOrigin(self._subject, self._steps(quantity), self.of.scatter_u(left, self.of.level), None)
        return span_finding(quantity, np.concatenate(left), origin, LAG, self._common(quantity, changes))


def _figures(left: Left) -> dict[str, float]:
    """Every figure by its quantity; spans in °."""
    static = np.concatenate(left.static)
    return {
        "K0/left_mean": float(np.mean(static)),
        "K0/left_largest": _about_mean(left.static),
        "K0/left_largest" + OF_DYNAMIC: _about_mean(left.dynamic),
        "K1/left_largest": _about_mean(left.scale),
        "tilt/uncompensated": _span_deg(left.uncompensated),
        "tilt/verified": _span_deg(left.static),
        "tilt/verified" + OF_DYNAMIC: _span_deg(left.dynamic),
    }


def _about_mean(records: Sequence[Array]) -> float:
    values = np.concatenate(records)
    return float(np.max(np.abs(values - np.mean(values))))


def _span_deg(records: Sequence[Array]) -> float:
    return math.degrees(float(np.ptp(np.concatenate(records))))
