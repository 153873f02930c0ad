"""Verification of a released calibration out of sample: what it leaves of bias and scale factor in a new tumble (6.4).

The model is that of another run of the same unit, applied at the temperatures of the new dwells, so that what is left
holds everything that its own data cannot show: hysteresis of another profile, drift since, interpolation between its
temperatures. Its own run cannot verify it; a run whose calibration is its own is refused when its data are read.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.methods.tumble.reduction.constants import TumbleConstants
from bench.methods.tumble.reduction.dwells import solve_dwells
from bench.methods.tumble.reduction.pair import Verified, tilt_in_tumble
from bench.methods.tumble.reduction.unit import TumbleUnit
from bench.metrology.acquisition import Array
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.common_errors import level_drift
from bench.metrology.extremes import interval_of_largest
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Finding, UnitResult
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.metrology.tilt import TiltAxis, tilt_of_one
from bench.metrology.tilt_findings import TiltOrigin, span_finding
from bench.metrology.tilt_pair import with_pairs

STEP_C = 0.5  # finite difference of a temperature
NAMES = {"K0": "bias that the calibration leaves", "K1": "scale factor that it leaves, relative"}


def reduce(data: RunData, settings: Mapping[str, Any]) -> list[UnitResult]:
    """Reduce a run to what the released calibration of every unit leaves at each dwell.

    Results of a pair that measures a tilt together are among those of its first unit.
    """
    return with_pairs(data, [_reduced(data, unit, settings) for unit in data.units], tilt_in_tumble)


def _reduced(data: RunData, unit: UnitUnderTest, settings: Mapping[str, Any]) -> tuple[UnitResult, Verified | None]:
    solved = solve_dwells(data, unit)
    known = None if unit.released is None else unit.released.of_output(unit.output_unit)
    if unit.released is None or known is None:
        flags = (Flag("not_given", of="calibration"),)
        return UnitResult(unit.place, unit.serial, (), (), ("calibration",), flags), None
    of = TumbleUnit.of(data, unit, solved.dwells)
    left = Left(of, known, unit.released.local_g(data.bench.gravity_mps2), solved.extra, settings["scale_per_c_u"])
    extrapolated = bool(solved.dwells) and left.is_extrapolated
    result = UnitResult(
        place=unit.place, uut=unit.serial, findings=tuple(left.findings()) if solved.dwells else (), models=(),
        left_out=solved.left_out,
        flags=tuple(dict.fromkeys((*solved.flags, *((Flag("calibration:extrapolated"),) if extrapolated else ())))),
    )  # fmt: skip
    return result, (of, known) if solved.dwells else None


@dataclass(frozen=True)
class Left:
    """What the conversion `known` leaves of one unit; `gravity` is local gravity in its g.

    `extra` are the further terms of the tumbles, `scale_per_c_u` the change of the scale factor with 1 °C that counts
    for the error of the thermometer besides that of the conversion.
    """

    of: TumbleUnit
    known: Compensation
    gravity: float
    extra: tuple[str, ...]
    scale_per_c_u: float

    @property
    def is_extrapolated(self) -> bool:
        """True if a dwell is outside of the temperatures of the calibration."""
        return bool(self.known.apply(np.zeros(len(self.of.dwells)), self.of.temperatures_c)[1].any())

    def bias_g(self, by_c: float = 0.0) -> Array:
        """Converted output (n,) of a level unit without misalignment, with all temperatures changed by `by_c`."""
        level = self.of.values("K0") * self.of.values("K1")
        return self.known.apply(level, self.of.temperatures_c + by_c)[0]

    def scale(self, by_c: float = 0.0) -> Array:
        """Converted change of output (n,) for 1 g, less 1."""
        up, level = (
            self.known.apply(each, self.of.temperatures_c + by_c)[0]
            for each in (self.of.values("K1"), np.zeros(len(self.of.dwells)))
        )
        return np.asarray((up - level) / self.gravity - 1)

    def findings(self) -> Iterator[Finding]:
        """Findings at each dwell, then the largest of all and the tilt of a level unit."""
        per_c = {
            "K0": (self.bias_g(STEP_C) - self.bias_g(-STEP_C)) / (2 * STEP_C),
            "K1": (self.scale(STEP_C) - self.scale(-STEP_C)) / (2 * STEP_C) * self.of.values("K1"),
        }
        constants = TumbleConstants(self.of, per_c, self.extra, {"K0": 0.0, "K1": self.scale_per_c_u})
        left = {"K0": self.bias_g(), "K1": self.scale()}
        at_dwells: dict[str, list[Finding]] = {"K0": [], "K1": []}
        for index in range(len(self.of.dwells)):
            found = {each.quantity: each for each in constants.findings(index)}
            for quantity, values in left.items():
                at_dwells[quantity].append(self._at_dwell(found[quantity], float(values[index])))
        for each in at_dwells.values():
            yield from each
            yield self._largest(each)
        yield from self._tilt(at_dwells["K0"], per_c["K0"])

    def _at_dwell(self, found: Finding, left: float) -> Finding:
        """The finding of a coefficient at a dwell with what is left of it; of the scale factor relative."""
        quantity, size = found.quantity, 1.0 if found.quantity == "K0" else abs(found.value)
        return replace(
            found, id=found.id.replace(f"/{quantity}", f"/{quantity}/left"), quantity=f"{quantity}/left",
            name=NAMES[quantity], value=left, unit="g" if quantity == "K0" else "1", flags=(),
            budget=tuple(line._replace(u=line.u / size) for line in found.budget),
        )  # fmt: skip

    def _largest(self, at_dwells: Sequence[Finding]) -> Finding:
        """Largest value that is left, with what scatter makes of it; errors common to all dwells do not cancel."""
        left, own = np.array([each.value for each in at_dwells]), self._own_u(at_dwells)
        worst = int(np.argmax(np.abs(left)))
        found, common = at_dwells[worst], math.sqrt(max(at_dwells[worst].u ** 2 - own[worst] ** 2, 0.0))
        return replace(
            found, id=self.of.subject.id(f"{found.quantity}_largest"), quantity=f"{found.quantity}_largest",
            name=f"{found.name}: largest", value=abs(found.value), at=self._where(found, worst),
            interval=interval_of_largest(left, own).beside(common),
        )  # fmt: skip

    def _own_u(self, at_dwells: Sequence[Finding]) -> Array:
        """Standard uncertainty (n,) by errors independent between dwells."""
        quantity = at_dwells[0].quantity.partition("/")[0]
        size = 1.0 if quantity == "K0" else np.abs(self.of.values("K1"))
        return np.asarray(self.of.own_u(quantity) / size)

    def _where(self, found: Finding, index: int) -> Mapping[str, Any]:
        return {"temperature_c": found.at["temperature_c"], "dwells": [self.of.dwells[index].path]}

    def _tilt(self, at_dwells: Sequence[Finding], per_c: Array) -> Iterator[Finding]:
        """Tilt that the unit indicates when level: the largest, and its span over the temperatures."""
        left_g, own_g = np.array([each.value for each in at_dwells]), self._own_u(at_dwells)
        indicated = tilt_of_one(TiltAxis(1.0, 0.0, 0.0, 0.0, float(np.mean(own_g))), left_g)
        worst = int(np.argmax(np.abs(indicated.tilt_deg)))
        found, degree = at_dwells[worst], float(np.degrees(1.0))
        common = math.sqrt(max(found.u**2 - own_g[worst] ** 2, 0.0)) * degree
        yield self.of.subject.finding(
            "tilt/left_largest", "largest tilt that it indicates when level",
            float(abs(indicated.tilt_deg[worst])), "°", [line._replace(u=line.u * degree) for line in found.budget],
            self._where(found, worst), found.steps,
            interval=interval_of_largest(indicated.tilt_deg, indicated.u_deg).beside(common),
        )  # fmt: skip
        origin = TiltOrigin(self.of.subject, (self.of.root,), float(np.mean(own_g)), self.of.dof or None)
        yield from span_finding("tilt/verified", left_g, origin, more=self._of_span(left_g, per_c))

    def _of_span(self, left_g: Array, per_c: Array) -> list[BudgetLine]:
        """Contributions in ° to the span of the tilt by errors that change over the run: thermometer, and level."""
        ends = np.zeros(len(left_g))
        ends[np.argmax(left_g)], ends[np.argmin(left_g)] = 1.0, -1.0
        line, level_rad = level_drift(self.of.data)
        by_level = float(ends @ level_rad(np.array([dwell.middle_s for dwell in self.of.dwells])))
        lines = [*self.of.by_thermometer(ends, per_c), line._replace(u=abs(by_level))]
        return [each.times(float(np.degrees(1.0))) for each in lines]
