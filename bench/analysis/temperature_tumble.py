"""Method M4a on counts: bias, scale factor, K2 and misalignment at each dwell, and their models over temperature.

A dwell is the acquisitions of one group of steps. Its readings are solved as a tumble (methods.md 6.2) at the angles
that the head read back; the temperature is what the unit's thermometer says. Type A is the scatter of the readings
about their tumbles, pooled over the run; type B comes from the certificates of the bench by the derivatives of the
solution.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from bench.analysis.counts import mean_rate
from bench.analysis.finding import BudgetLine, Finding, TemperatureModel, UnitResult, combined
from bench.analysis.fit import NotDetermined, PolynomialFit, fit_polynomial
from bench.analysis.rundata import Acquisition, Array, BenchRecord, RunData, UnitUnderTest
from bench.analysis.tumble import IncompleteTumble, Tumble, hysteresis, solve_tumble

QUANTITIES = ("K0", "K1", "misalignment", "K2")
UNITS = {"K0": "g", "K1": "pulse/s/g", "misalignment": "rad", "K2": "g/g²", "K1_si": "pulse/s/(m/s²)"}
NAMES = {
    "K0": "bias of the channel",
    "K1": "scale factor of the channel, per local g",
    "K1_si": "scale factor of the channel, per m/s²",
    "K2": "K2 + asymmetry: second-order nonlinearity with the converter's asymmetry in it",
    "misalignment": "misalignment of the input axis in the plane of the tumble",
}
FLAGS = {"K1": ("contains:K3",), "K1_si": ("contains:K3",), "K2": ("contains:asymmetry",)}


@dataclass(frozen=True, slots=True)
class Dwell:
    """One temperature of one unit: the readings used, and their solution.

    `gain` (4, n) turns errors of the readings (pulse/s) into errors of K0, K1, misalignment and K2; `turn` (n,) is the
    derivative of each reading to its angle, pulse/s/rad; `head_rad` (n,) are the head's angles.
    """

    number: int
    group: str
    loops: Mapping[str, float]
    set_c: float
    temperature_c: float
    at_s: float
    rising: bool
    tumble: Tumble
    gain: Array
    turn: Array
    head_rad: Array
    rates_pps: Array
    steps: tuple[str, ...]
    levels: Array  # sine of each reading's angle above the horizontal

    @property
    def values(self) -> Mapping[str, float]:
        """The four quantities."""
        solved = self.tumble
        found = (solved.k0_g, solved.k1, solved.misalignment_rad, solved.k2_g_per_g2)
        return dict(zip(QUANTITIES, found, strict=True))

    @property
    def path(self) -> str:
        """The loops around it: `cycle=1/temperature=20`."""
        return self.group.partition("/")[2]


def reduce(data: RunData, settings: Mapping[str, int]) -> list[UnitResult]:
    """The findings and models of every unit; `settings` has the degree of the temperature models."""
    return [_Unit(data, unit, settings["degree"]).result() for unit in data.units]


class _Unit:
    """The reduction of one unit."""

    def __init__(self, data: RunData, unit: UnitUnderTest, degree: int) -> None:
        self._data, self._unit, self._bench, self._degree = data, unit, data.bench, degree
        self._flags: list[str] = []
        self._left_out: list[str] = []
        self._dwells = list(self._solved())
        self._sd_pps, self._dof = self._pooled()
        self._models = {quantity: self._fit(quantity, degree) for quantity in ("K0", "K1")}

    def result(self) -> UnitResult:
        findings = [finding for dwell in self._dwells for finding in self._at_dwell(dwell)]
        for quantity in ("K0", "K1"):
            findings += self._over_temperature(quantity)
        models = [
            self._model(quantity, fit)
            for quantity, fitted in self._models.items()
            for fit in (fitted, self._fit(quantity, 1) if fitted is not None and fitted.degree > 1 else None)
            if fit is not None
        ]
        return UnitResult(
            self._unit.place, self._unit.serial, tuple(findings), tuple(models), tuple(dict.fromkeys(self._flags))
        )

    def _id(self, tail: str) -> str:
        return f"{self._data.label}/{self._unit.place}/{tail}"

    # Dwells

    def _solved(self) -> Iterator[Dwell]:
        groups: dict[str, list[Acquisition]] = {}
        for acquisition in self._data.acquisitions:
            groups.setdefault(acquisition.group, []).append(acquisition)
        set_points = [acquisitions[0].set_c for acquisitions in groups.values()]
        rising = _rising(set_points)
        for number, (group, acquisitions) in enumerate(groups.items()):
            dwell = self._dwell(number, group, acquisitions, rising[number])
            if dwell is None:
                self._left_out.append(group.partition("/")[2])
            else:
                yield dwell

    def _dwell(self, number: int, group: str, acquisitions: list[Acquisition], rising: bool) -> Dwell | None:
        """The solved dwell; None, and a flag, when its usable readings do not determine it."""
        used, rates = [], []
        for acquisition in acquisitions:
            rate = mean_rate(acquisition.counts[self._unit.channel])
            self._flags += [f"{acquisition.step}: {problem}" for problem in rate.problems]
            if not rate.problems and len(acquisition.temperatures_c[self._unit.temperature]):
                used.append(acquisition)
                rates.append(rate.net_pps)
        head_deg = np.array([acquisition.angle_deg for acquisition in used])
        angle = np.radians(self._angle_deg(head_deg))
        try:
            tumble = solve_tumble(angle, np.array(rates))
        except IncompleteTumble as problem:
            missing = ", ".join(f"{position:g}" for position in problem.missing_deg) or "ill_conditioned"
            self._flags.append(f"dwell {number} incomplete: {missing}")
            return None
        temperatures = [acquisition.temperatures_c[self._unit.temperature].mean() for acquisition in used]
        sine, cosine = np.sin(angle), np.cos(angle)
        return Dwell(
            number=number,
            group=group,
            loops=used[0].loops,
            set_c=used[0].set_c,
            temperature_c=float(np.mean(temperatures)),
            at_s=float(np.mean([(acquisition.begin_s + acquisition.end_s) / 2 for acquisition in used])),
            rising=rising,
            tumble=tumble,
            gain=tumble.gain(),
            turn=tumble.k1 * (cosine - tumble.misalignment_rad * sine + 2 * tumble.k2_g_per_g2 * sine * cosine),
            head_rad=np.radians(head_deg),
            rates_pps=np.array(rates),
            steps=tuple(acquisition.step for acquisition in used),
            levels=sine,
        )

    def _angle_deg(self, head_deg: Array) -> Array:
        """The input axis above the horizontal."""
        bench = self._bench
        return bench.sense * head_deg + bench.offset_deg + self._unit.mount_angle_deg + bench.level_deg

    def _pooled(self) -> tuple[float, int]:
        """Standard deviation of one reading in pulse/s about its tumble, over all dwells, and its degrees of freedom."""
        dof = sum(dwell.tumble.fit.dof for dwell in self._dwells)
        squares = sum(float(np.sum(dwell.tumble.fit.residuals**2)) for dwell in self._dwells)
        if dof == 0:
            self._flags.append("type_a:no_repeats")
            return 0.0, 0
        return float(np.sqrt(squares / dof)), dof

    # Models over temperature

    def _fit(self, quantity: str, degree: int) -> PolynomialFit | None:
        """The model of the highest degree up to `degree` that the temperatures allow."""
        temperature = np.array([dwell.temperature_c for dwell in self._dwells])
        values = np.array([dwell.values[quantity] for dwell in self._dwells])
        allowed = min(degree, len(np.unique([dwell.set_c for dwell in self._dwells])) - 1)
        if allowed < degree:
            self._flags.append(f"{quantity}:too_few_temperatures")
        try:
            return fit_polynomial(temperature, values, allowed) if allowed > 0 else None
        except NotDetermined:
            return None

    def _model(self, quantity: str, fit: PolynomialFit) -> TemperatureModel:
        return TemperatureModel(
            id=self._id(f"{quantity}/model={fit.degree}"),
            uut=self._unit.serial,
            quantity=quantity,
            unit=UNITS[quantity],
            centre=fit.centre,
            scale=fit.scale,
            coefficients=_floats(fit.coefficients),
            u=_floats(fit.u) if fit.dof else (0.0,) * (fit.degree + 1),
            correlation=tuple(_floats(row) for row in fit.correlation),
            powers_of_t=_floats(fit.powers),
            residual_sd=fit.residual_sd if fit.dof else None,
            dof=fit.dof,
            max_residual=fit.max_residual,
            valid_c=fit.valid,
            dwells_used=len(self._dwells),
            dwells_left_out=tuple(self._left_out),
        )

    # Findings

    def _at_dwell(self, dwell: Dwell) -> Iterator[Finding]:
        at = {
            **dwell.loops,
            "dwell": dwell.number,
            "leg": "up" if dwell.rising else "down",
            "temperature_set_c": dwell.set_c,
            "temperature_c": dwell.temperature_c,
            "temperature_u_c": self._temperature_u_c(dwell.temperature_c),
        }
        for quantity in ("K0", "K1", "K2", "misalignment"):
            row = QUANTITIES.index(quantity)
            finding = Finding(
                id=self._id(f"{quantity}@{dwell.path}"),
                uut=self._unit.serial,
                quantity=quantity,
                name=NAMES[quantity],
                at=at,
                value=dwell.values[quantity],
                unit=UNITS[quantity],
                budget=self._budget(quantity, row, dwell),
                steps=tuple(
                    step for step, weight in zip(dwell.steps, dwell.gain[row], strict=True) if abs(weight) > 1e-9
                ),
                flags=FLAGS.get(quantity, ()),
            )
            yield finding
            if quantity == "K1":
                yield self._per_mps2(finding, dwell)

    def _per_mps2(self, k1: Finding, dwell: Dwell) -> Finding:
        g = self._bench.gravity_mps2
        lines = [
            BudgetLine("K1", "B", k1.u / g, k1.dof, k1.id),
            BudgetLine("site: gravity", "B", k1.value / g * self._bench.gravity_u_mps2 / g, None, "site.gravity"),
        ]
        return Finding(
            id=self._id(f"K1_si@{dwell.path}"), uut=k1.uut, quantity="K1_si", name=NAMES["K1_si"], at=k1.at,
            value=k1.value / g, unit=UNITS["K1_si"], budget=combined(lines), steps=(dwell.group,), flags=FLAGS["K1_si"],
        )  # fmt: skip

    def _budget(self, quantity: str, row: int, dwell: Dwell) -> tuple[BudgetLine, ...]:
        bench, per_rad = self._bench, dwell.gain[row] * dwell.turn
        harmonics = [
            per_rad @ shape(order * dwell.head_rad) * u
            for order, u in enumerate(np.radians(bench.harmonics_u_deg), start=1)
            for shape in (np.cos, np.sin)
        ]
        scatter = self._sd_pps * float(np.linalg.norm(dwell.gain[row]))
        repeat = np.radians(bench.repeatability_u_deg) * float(np.linalg.norm(per_rad))
        lines = [
            BudgetLine("readings: scatter pooled over the run", "A", scatter, self._dof or None),
            BudgetLine("head: zero", "B", abs(float(per_rad.sum())) * np.radians(bench.zero_u_deg), None, "head.zero"),
            BudgetLine("head: harmonics", "B", float(np.linalg.norm(harmonics)), None, "head.harmonics"),
            BudgetLine("head: repeatability", "B", float(repeat), None, None),
            BudgetLine(
                "fixture: level", "B", abs(float(per_rad.sum())) * np.radians(bench.level_u_deg), None, "fixture.level"
            ),
            BudgetLine(
                "counter: time base", "B", abs(float(dwell.gain[row] @ dwell.rates_pps)) * bench.time_base_u, None,
                "counter.time_base",
            ),
        ]  # fmt: skip
        model = self._models.get(quantity)
        if model is not None:
            u = abs(float(model.slope(dwell.temperature_c))) * self._temperature_u_c(dwell.temperature_c)
            name = self._unit.temperature
            lines.append(BudgetLine(f"{name}: offset, gain", "B", u, None, name))
        if quantity == "K2":
            lines.append(BudgetLine("asymmetry of the converter, inseparable at four positions", "alias", 0.0))
        return combined(lines)

    def _temperature_u_c(self, temperature_c: float) -> float:
        offset_c, gain = self._bench.thermometers_u.get(self._unit.temperature, (0.0, 0.0))
        return float(np.hypot(offset_c, gain * temperature_c))

    def _over_temperature(self, quantity: str) -> Iterator[Finding]:
        """What is said of the whole run: slope, hysteresis, residual of the model."""
        model, line = self._models[quantity], self._fit(quantity, 1)
        if model is None or line is None:
            return
        yield self._coefficient(quantity, line)
        row = QUANTITIES.index(quantity)
        scale = 1.0 if quantity == "K0" else 1 / float(line.value(line.centre))
        scatter = self._sd_pps * max(float(np.linalg.norm(dwell.gain[row])) for dwell in self._dwells) * scale
        loop = self._hysteresis(quantity, model)
        if loop is not None:
            yield self._largest(
                f"{quantity}/hysteresis", "largest difference between rising and falling temperature",
                loop[0] * scale, scatter * np.sqrt(2), loop[1:],
            )  # fmt: skip
        worst = int(np.argmax(np.abs(model.residuals)))
        yield self._largest(
            f"{quantity}/model_residual", f"largest residual of the model of degree {model.degree}",
            model.max_residual * scale, scatter, (worst,),
        )  # fmt: skip

    def _hysteresis(self, quantity: str, model: PolynomialFit) -> tuple[float, int, int] | None:
        dwells = self._dwells
        loop = hysteresis(
            np.array([dwell.values[quantity] for dwell in dwells]),
            np.array([dwell.temperature_c for dwell in dwells]),
            np.array([dwell.set_c for dwell in dwells]),
            rising=np.array([dwell.rising for dwell in dwells]),
            cycle=np.array([int(dwell.loops.get("cycle", 1)) for dwell in dwells]),
            slope=model.slope,
        )
        return (loop.value, loop.rising, loop.falling) if loop is not None else None

    def _coefficient(self, quantity: str, line: PolynomialFit) -> Finding:
        """The slope of the straight line: K0 in g/°C, K1 relative to its value at the centre."""
        slope = float(line.coefficients[1]) / line.scale
        u = float(line.u[1]) / line.scale if line.dof else 0.0
        unit, name = "g/°C", "slope of the straight line through the bias"
        if quantity == "K1":
            middle = float(line.value(line.centre))
            slope, u = slope / middle, u / middle
            unit, name = "1/°C", "relative slope of the straight line through the scale factor"
        _, gain = self._bench.thermometers_u.get(self._unit.temperature, (0.0, 0.0))
        source = self._unit.temperature
        lines = [
            BudgetLine("fit", "A", u, line.dof or None),
            BudgetLine(f"{source}: gain", "B", abs(slope) * gain, None, source),
        ]
        return Finding(
            id=self._id(f"{quantity}/temperature_coefficient"), uut=self._unit.serial,
            quantity=f"{quantity}/temperature_coefficient", name=name, at={"temperature_c": line.centre}, value=slope,
            unit=unit, budget=combined(lines), steps=(self._root(),),
        )  # fmt: skip

    def _largest(self, quantity: str, name: str, value: float, u: float, dwells: tuple[int, ...]) -> Finding:
        """A largest value over the dwells; its uncertainty is that of the readings, all else is common to them."""
        found = [self._dwells[index] for index in dwells]
        at = {
            "temperature_set_c": found[0].set_c,
            "temperature_c": float(np.mean([dwell.temperature_c for dwell in found])),
            "dwells": [dwell.path for dwell in found],
        }
        budget = combined([BudgetLine("readings: scatter pooled over the run", "A", float(u), self._dof or None)])
        return Finding(
            id=self._id(quantity), uut=self._unit.serial, quantity=quantity, name=name, at=at, value=value,
            unit="g" if quantity.startswith("K0") else "1", budget=budget,
            steps=tuple(dwell.group for dwell in found),
        )  # fmt: skip

    def _root(self) -> str:
        """The steps that all dwells are below."""
        first = self._dwells[0].group.split("/")
        return "/".join(first[:-1])


def _rising(set_points: list[float]) -> list[bool]:
    """Whether each dwell was reached by rising temperature; the first takes the direction of its departure."""
    steps = np.diff(np.array(set_points))
    rising: list[bool] = []
    for index in range(len(set_points)):
        before = steps[:index][steps[:index] != 0]
        after = steps[index:][steps[index:] != 0]
        deciding = before[-1] if len(before) else after[0] if len(after) else 1.0
        rising.append(bool(deciding > 0))
    return rising


def _floats(values: Array) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
