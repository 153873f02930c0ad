"""Findings of a calibration on an indexing table, each with its budget, and its equations.

With both ends the results describe the unit; with one end there is only the equation for tests in that orientation.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.methods.indexing.reduction.budget import BACKLASH, SCATTER, TILT, IndexingBudget
from bench.methods.indexing.reduction.calibrate import StaticCalibration
from bench.methods.indexing.reduction.estimates import IndexingEstimates
from bench.methods.indexing.reduction.model import SweepModel
from bench.methods.indexing.reduction.sweep import EndFit
from bench.methods.indexing.reduction.two_ends import BothEnds
from bench.methods.indexing.reduction.verification import SELECTION, Verification
from bench.methods.indexing.words import CORRECTED, ENDS, ON_THE_GROUND, ORBIT
from bench.metrology.extremes import interval_of_largest, largest_u
from bench.metrology.least_squares import Array
from bench.metrology.nonlinear import NonlinearFit
from bench.metrology.propagation import Estimate, Measured
from bench.metrology.results.budget import BudgetLine, common
from bench.metrology.results.curves import Constant, Equation
from bench.metrology.results.finding import Finding, Interval
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import RunData, UnitUnderTest

TILT_SOURCES = {"b3": "fixture: level", "b4": "platform: angle"}
TILT_NAMES = {"b3": "tilt by the level of the fixture", "b4": "tilt of the platform"}
LINE = "a = (U - b) / K1"
INPUTS = ("a = sin(θ + s·δ)", "a_z = s·cos(θ + s·δ)")


@dataclass(frozen=True)
class IndexingFindings:
    """Results of one unit, from the last attempt at both ends, `found`.

    All is at one temperature; the settings state the change per 1 °C of the bias (g) and of the scale factor
    (relative).
    """

    data: RunData
    unit: UnitUnderTest
    found: StaticCalibration
    estimates: IndexingEstimates
    verification: Verification
    bias_per_c_u: float
    scale_per_c_u: float

    # Findings

    def findings(self) -> Iterator[Finding]:
        """All findings that a limit may name."""
        both = self.estimates.both
        if both is not None:
            yield from self._of_the_unit(both)
            yield from self._of_the_mounting(both)
        for name, fit in self.estimates.fits.items():
            yield self._linearity(name, fit)
        yield from self._hysteresis()
        yield from self.verification.findings()

    def _of_the_unit(self, both: BothEnds) -> Iterator[Finding]:
        output, at, scale = self.unit.output_unit, self._at, both.scale
        known = (*self._unknown_tilt(both, 1 / abs(scale.value)), *self._thermometer(self.bias_per_c_u))
        of_scale = tuple(self._thermometer(scale.value * self.scale_per_c_u))
        yield self._finding("K0", "bias of the equation for use in orbit", both.corrected / scale, "g", at, known)
        yield (
            k1 := self._finding("K1", "scale factor of the channel, per local g", scale, f"{output}/g", at, of_scale)
        )
        yield self._per_mps2(k1)
        if both.tilted is not None:
            yield self._finding("misalignment", "of the input axis towards +Z", both.tilted / scale, "rad", at)
        if both.coupling is not None:
            name = "cross coupling of the input axis and Z"
            yield self._finding("Kip", name, both.coupling / scale, "g/g²", at)
        yield from self._higher_orders()
        (_, up), (_, down) = self.estimates.line("up"), self.estimates.line("down")
        flags = ("ends_differ",) if self.found.decision == "repeat" else ()
        name = "scale factor with +Z up minus with +Z down, relative"
        yield self._finding("scale_difference", name, (up - down) / scale, "1", at, flags=flags)

    def _higher_orders(self) -> Iterator[Finding]:
        """K2 and K3, if the angles are large enough to determine them."""
        model, c1 = self.found.model, self.found.model.value("c1")
        if model.fit is None or not c1:
            return
        for quantity, term, unit in (("K2", "c2", "g/g²"), ("K3", "c3", "g/g³")):
            value = model.value(term)
            if value is not None:
                u = float(model.fit.u[model.terms.index(term)] / abs(c1))
                lines = (BudgetLine(SCATTER, "A", u, self.estimates.budget.dof or None),)
                yield self._of(quantity, "of the model of all readings", value / c1, unit, lines, self._at)

    def _per_mps2(self, k1: Finding) -> Finding:
        bench, unit = self.data.bench, f"{self.unit.output_unit}/(m/s²)"
        value = k1.value / bench.gravity_mps2
        lines = [BudgetLine("K1", "B", k1.u / bench.gravity_mps2, None, k1.id), bench.gravity(value)]
        return self._of("K1_si", "scale factor of the channel, per m/s²", value, unit, lines, self._at)

    def _of_the_mounting(self, both: BothEnds) -> Iterator[Finding]:
        """Measured bias, contributions of the mounting, and remaining bias."""
        output, at, scale = self.unit.output_unit, self._at, both.scale
        warm = tuple(self._thermometer(scale.value * self.bias_per_c_u))
        known = (*self._unknown_tilt(both), *warm)
        yield self._finding("bias", "mean of both ends, tilt of the seat in it", both.bias, output, at, warm)
        yield self._finding("bias_corrected", "without the tilt of the seat", both.corrected, output, at, known)
        yield self._finding("bias_total", "b + b3 + b4 + b5, kept for comparison", both.total, output, at, known)
        for quantity, tilt in self.estimates.tilts.items():
            value, line = scale.value * float(np.sin(tilt.value)), _tilt_line(quantity, tilt, scale.value)
            yield self._of(quantity, TILT_NAMES[quantity], value, output, (line,), at)
        if both.beyond is not None:
            known = tuple(_tilt_line(*each, scale.value) for each in self.estimates.tilts.items())
            name = "tilt of the seat beyond b3 and b4, by clocking"
            yield self._finding("b5", name, both.beyond, output, at, known, without=TILT)
            yield from self._seat_tilt(scale.value)

    def _unknown_tilt(self, both: BothEnds, factor: float = 1.0) -> tuple[BudgetLine, ...]:
        """Uncertainty of the platform without a clocking; the level is already among the sources."""
        platform = self.estimates.tilts.get("b4")
        if both.seat is not None or platform is None:
            return ()
        return (_tilt_line("b4", platform, both.scale.value * factor),)

    def _seat_tilt(self, scale: float) -> Iterator[Finding]:
        clocking, budget = self.estimates.clocking, self.estimates.budget
        if clocking is None or clocking.q_v is None:
            return
        tilt_rad = float(np.hypot(clocking.p_v, clocking.q_v) / abs(scale))
        u_rad = clocking.u_per_reading * self.estimates.reading_sd_g
        lines = (BudgetLine(SCATTER, "A", u_rad, budget.dof or None),)
        yield self._of("seat_tilt", "of the seat against the horizontal", tilt_rad, "rad", lines, self._at)

    def _linearity(self, end: str, fit: EndFit) -> Finding:
        span = abs(fit.scale_v_per_g) * float(np.ptp(np.sin(fit.dwells.angle_rad)))
        sd = self.estimates.reading_sd_g * abs(self.estimates.budget.scale)
        by_scatter, by_selection = largest_u(fit.residuals, sd)
        lines = [
            BudgetLine(SCATTER, "A", by_scatter / span, self.estimates.budget.dof or None),
            BudgetLine(SELECTION, "A", by_selection / span),
        ]
        name = "largest residual as a part of the span of the output"
        interval = interval_of_largest(fit.residuals, sd).times(1 / span)
        at = {"end": end}
        return self._of("linearity", name, fit.linearity, "1", lines, at, tail=f"/{end}", interval=interval)

    def _hysteresis(self) -> Iterator[Finding]:
        """Largest difference between readings from below and from above at one angle, over both ends.

        Its budget is that of a difference by noise alone. None if each angle was approached from one side only.
        """
        loops = {name: fit for name, fit in self.estimates.fits.items() if len(fit.loop_v)}
        if not loops:
            return
        worst = max(loops, key=lambda name: loops[name].hysteresis_v or 0.0)
        every_g = np.concatenate([fit.loop_v for fit in loops.values()]) / self.estimates.budget.scale
        sd_g = self.estimates.reading_sd_g * float(np.sqrt(2.0))
        by_scatter, by_selection = largest_u(every_g, sd_g)
        lines = [
            BudgetLine(SCATTER, "A", by_scatter, self.estimates.budget.dof or None),
            BudgetLine(SELECTION, "A", by_selection),
            common(BACKLASH, np.radians(self.data.bench.head.backlash_u_deg or 0.0)),
        ]
        value = float(np.max(np.abs(every_g)))
        name = "largest difference between readings at one angle, come to from below and from above"
        interval = interval_of_largest(every_g, sd_g)
        yield self._of("hysteresis", name, value, "g", lines, {"end": worst}, interval=interval)

    # Equations

    def models(self) -> Iterator[Equation]:
        """Equations for use in orbit and for each end on the ground, and the model of all readings."""
        output = self.unit.output_unit
        both = self.estimates.both
        if both is not None:
            known = self._unknown_tilt(both)
            yield self._equation("orbit", "acceleration", ORBIT, both.corrected, both.scale, known)
        for name in self.estimates.fits:
            bias, scale = self.estimates.line(name)
            clauses = (*ORBIT, ON_THE_GROUND[name])
            yield self._equation(f"end_{name}", f"acceleration_{name}", clauses, bias, scale)
        for found in self.verification.regressions:
            if found.differs:
                yield self._equation(
                    f"end_{found.end}_corrected", f"corrected_acceleration_{found.end}",
                    (*ORBIT, ON_THE_GROUND[found.end], CORRECTED), found.bias, found.slope, budget=found.budget,
                )  # fmt: skip
        model = self.found.model
        if model.fit is not None and both is not None:
            units = {"c0": output, "delta": "rad", "cxz": f"{output}/g²", "c2": f"{output}/g²", "c3": f"{output}/g³"}
            yield Equation(
                id=self._id("equation/all"),
                uut=self.unit.serial,
                quantity="output",
                form=f"U = c0 + c1·a{' + c2·a² + c3·a³' if 'c2' in model.terms else ''} + cxz·a·a_z",
                constants=_constants(model, model.fit, units, f"{output}/g"),
                valid=self._valid,
                correlation=tuple(tuple(float(value) for value in row) for row in _correlation(model.fit.covariance)),
                clauses=tuple(map(Flag, (*INPUTS, *ENDS))),
            )

    def _equation(
        self, name: str, quantity: str, clauses: tuple[str, ...], bias: Estimate, scale: Estimate,
        known: tuple[BudgetLine, ...] = (), budget: IndexingBudget | None = None,
    ) -> Equation:  # fmt: skip
        output, budget = self.unit.output_unit, budget or self.estimates.budget
        u_bias, u_scale = (
            float(np.sqrt(sum(line.u**2 for line in (*budget.lines(each), *more))))
            for each, more in ((bias, known), (scale, ()))
        )
        return Equation(
            id=self._id(f"equation/{name}"),
            uut=self.unit.serial,
            quantity=quantity,
            form=LINE,
            constants={"b": Constant(bias.value, output, u_bias), "K1": Constant(scale.value, f"{output}/g", u_scale)},
            valid=self._valid,
            correlation=budget.correlation([bias, scale]),
            clauses=tuple(map(Flag, clauses)),
        )

    @property
    def _valid(self) -> Mapping[str, tuple[float, float]]:
        sines = np.sin([each.angle_rad for each in self.estimates.rows if each.kind == "sweep"])
        warm_c = [each.temperature_c for each in self.estimates.rows if np.isfinite(each.temperature_c)]
        valid = {"input_g": (float(sines.min()), float(sines.max()))}
        return valid | ({"temperature_c": (min(warm_c), max(warm_c))} if warm_c else {})

    # Parts of findings

    @property
    def _at(self) -> Mapping[str, Any]:
        warm_c = [each.temperature_c for each in self.estimates.rows if np.isfinite(each.temperature_c)]
        return {"at_c": float(np.mean(warm_c))} if warm_c else {}

    def _thermometer(self, per_c: float) -> Iterator[BudgetLine]:
        """Line for the temperature of a result that changes by `per_c` with 1 °C."""
        if (at_c := self._at.get("at_c")) is not None:
            yield self.data.bench.temperature(self.unit.temperature, at_c).times(per_c)

    def _id(self, quantity: str) -> str:
        return self.data.subject(self.unit).id(quantity)

    def _finding(
        self,
        quantity: str,
        name: str,
        result: Estimate,
        unit: str,
        at: Mapping[str, Any],
        known: tuple[BudgetLine, ...] = (),
        without: str = "",
        flags: tuple[str, ...] = (),
    ) -> Finding:
        lines = [*self.estimates.budget.lines(result, without), *known]
        return self._of(quantity, name, result.value, unit, lines, at, flags=flags)

    def _of(
        self,
        quantity: str,
        name: str,
        value: float,
        unit: str,
        lines: Sequence[BudgetLine],
        at: Mapping[str, Any],
        tail: str = "",
        flags: tuple[str, ...] = (),
        interval: Interval | None = None,
    ) -> Finding:
        steps = tuple(dict.fromkeys(each.step.rsplit("/", 2)[0] for each in self.estimates.rows))
        subject = self.data.subject(self.unit)
        return subject.finding(quantity, name, value, unit, lines, at, steps, tail, flags, interval)


def _tilt_line(quantity: str, tilt: Measured, scale: float) -> BudgetLine:
    return common(TILT_SOURCES[quantity], scale * tilt.u)


def _constants(model: SweepModel, fit: NonlinearFit, units: Mapping[str, str], otherwise: str) -> dict[str, Constant]:
    values = zip(model.terms, fit.parameters.tolist(), fit.u.tolist(), strict=True)
    return {term: Constant(value, units.get(term, otherwise), u) for term, value, u in values}


def _correlation(covariance: Array) -> Array:
    sizes = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(sizes, sizes)) if np.all(sizes > 0) else np.eye(len(sizes))
