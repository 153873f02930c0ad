"""A dwell of a temperature tumble: the acquisitions at one temperature, solved as a tumble (equations 6.2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.methods.tumble.reduction.solution import IncompleteTumble, Tumble, further_terms, solve_tumble
from bench.metrology.acquisition import Acquisition, Array, Output
from bench.metrology.bench_uncertainty import BenchRecord
from bench.metrology.orientation import elevation_rad, is_clocked
from bench.metrology.outputs import mean_output
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import RunData, UnitUnderTest

DWELL_INCOMPLETE = "dwell {number} incomplete: {angles}"
DWELL_ILL_CONDITIONED = "dwell {number} incomplete: ill_conditioned"


@dataclass(frozen=True, slots=True)
class SolvedDwell:
    """The tumble at one visit of a set point; `temperature_c` is the mean of what the thermometer said."""

    number: int
    cycle: int
    rising: bool
    set_c: float
    temperature_c: float
    tumble: Tumble


@dataclass(frozen=True, slots=True)
class Dwell(SolvedDwell):
    """One temperature of one unit in a run: the readings used, and their solution.

    `readings` (n,) of the output, in its unit, were taken at the head's angles `head_rad` (n,). `gain` is the
    sensitivity of the coefficients to the readings, a row (n,) for each in the order of `values`; `turn` (n,) is the
    derivative of a reading with respect to its angle, per rad. `middle_s` is the mean bench time of the readings.
    `single_u` is the single-reading standard uncertainty, `quantisation_u` (n,) the quantisation uncertainty of each.
    It is `interrupted` if the unit was without power between two of its readings.
    """

    group: str
    middle_s: float
    readings: Array
    head_rad: Array
    gain: Array
    turn: Array
    single_u: float
    steps: tuple[str, ...]
    quantisation_u: Array
    interrupted: bool = False

    @property
    def values(self) -> Mapping[str, float]:
        """Coefficients of the tumble."""
        return self.tumble.values

    def gain_of(self, quantity: str) -> Array:
        """Sensitivity of a coefficient to the readings: (n,)."""
        return np.asarray(self.gain[list(self.tumble.values).index(quantity)])

    @property
    def path(self) -> str:
        """Loops around it: `cycle=1/temperature=20`."""
        return self.group.partition("/")[2]


@dataclass(frozen=True, slots=True)
class SolvedDwells:
    """Dwells of one unit; `left_out` are the paths of those that could not be solved, `flags` give the reasons.

    `extra` are the further terms that the angles of all dwells together separate, `angles` the number of different
    angles.
    """

    dwells: tuple[Dwell, ...]
    left_out: tuple[str, ...]
    flags: tuple[Flag, ...]
    extra: tuple[str, ...]
    angles: int


def solve_dwells(data: RunData, unit: UnitUnderTest) -> SolvedDwells:
    """Solve every group of acquisitions of a run for one unit, in order of measurement."""
    groups = data.groups()
    angle_rad = axis_rad(data.acquisitions, unit, data.bench)
    extra = further_terms(angle_rad, _clocked(data.acquisitions, unit, data.bench))
    rising = _rising([acquisitions[0].set_c for acquisitions in groups.values()])
    dwells: list[Dwell] = []
    left_out: list[str] = []
    flags: list[Flag] = []
    for number, (group, acquisitions) in enumerate(groups.items()):
        used, outputs = _usable(acquisitions, unit, flags)
        try:
            dwells.append(_solved(number, rising[number], used, outputs, unit, data.bench, extra))
        except IncompleteTumble as problem:
            flags.append(_incomplete(number, problem.missing_deg))
            left_out.append(group.partition("/")[2])
    angles = len(np.unique(np.degrees(angle_rad).round(1) % 360))
    return SolvedDwells(tuple(dwells), tuple(left_out), tuple(flags), extra, angles)


def _incomplete(number: int, missing_deg: Sequence[float]) -> Flag:
    if not missing_deg:
        return Flag(DWELL_ILL_CONDITIONED, values={"number": number})
    angles = ", ".join(f"{position:g}" for position in missing_deg)
    return Flag(DWELL_INCOMPLETE, values={"number": number, "angles": angles})


def axis_rad(acquisitions: Sequence[Acquisition], unit: UnitUnderTest, bench: BenchRecord) -> Array:
    """Nominal angles (n,) of the input axis above the horizontal."""
    return np.array([elevation_rad(acquisition, unit, bench) for acquisition in acquisitions])


def _clocked(acquisitions: Sequence[Acquisition], unit: UnitUnderTest, bench: BenchRecord) -> NDArray[np.bool_]:
    """Acquisitions (n,) with the unit rotated by 90° about its input axis."""
    return np.array([is_clocked(acquisition, unit, bench) for acquisition in acquisitions], dtype=np.bool_)


def _usable(
    acquisitions: Sequence[Acquisition], unit: UnitUnderTest, flags: list[Flag]
) -> tuple[list[Acquisition], list[Output]]:
    """Acquisitions with usable output and temperature, and their outputs; the others are flagged."""
    used, outputs = [], []
    for acquisition in acquisitions:
        output = mean_output(acquisition, unit)
        problems = list(output.problems)
        if not len(acquisition.temperatures_c[unit.temperature]):
            problems.append("no_temperature")
        flags += [Flag(problem, at=acquisition.step) for problem in problems]
        if not problems:
            used.append(acquisition)
            outputs.append(output)
    return used, outputs


def _solved(
    number: int,
    rising: bool,
    used: Sequence[Acquisition],
    outputs: Sequence[Output],
    unit: UnitUnderTest,
    bench: BenchRecord,
    extra: tuple[str, ...],
) -> Dwell:
    """Solution of one dwell; raises IncompleteTumble."""
    head_deg = np.array([acquisition.angle_deg for acquisition in used])
    angle, clocked = axis_rad(used, unit, bench), _clocked(used, unit, bench)
    readings = np.array([output.value for output in outputs])
    time_s = np.array([(acquisition.begin_s + acquisition.end_s) / 2 for acquisition in used])
    tumble = solve_tumble(angle, readings, extra, time_s, clocked)
    return Dwell(
        number=number,
        group=used[0].group,
        cycle=int(used[0].loops.get("cycle", 1)),
        rising=rising,
        set_c=used[0].set_c,
        temperature_c=float(np.mean([acquisition.temperatures_c[unit.temperature].mean() for acquisition in used])),
        middle_s=float(np.mean(time_s)),
        tumble=tumble,
        readings=readings,
        head_rad=np.radians(head_deg),
        gain=tumble.gain(),
        turn=tumble.per_rad(angle, clocked),
        single_u=float(np.mean([output.single_u for output in outputs])),
        steps=tuple(acquisition.step for acquisition in used),
        quantisation_u=np.array([output.quantisation_u for output in outputs]),
        interrupted=len({acquisition.stretch for acquisition in used}) > 1,
    )


def _rising(set_points: Sequence[float]) -> list[bool]:
    """Mask of dwells reached by rising temperature; the first takes the direction of its departure."""
    steps = np.diff(np.array(set_points))
    rising = []
    for index in range(len(set_points)):
        before, after = steps[:index], steps[index:]
        deciding = [*before[before != 0][-1:], *after[after != 0][:1], 1.0][0]
        rising.append(bool(deciding > 0))
    return rising
