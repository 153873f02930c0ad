"""Readings of a calibration on an indexing table from the acquisitions of a run (equations 3.2).

The end or side on which a unit stands, its angle and its clocking follow from the geometry of the bench. Readings in a
group `clocking` are those of the clocking, those in a group `verification` are not fitted, all others are the sweeps;
the loop `reverse` around a reading marks the reverse pass, the loop `pass` the number of preceding measurements of both
ends. The side of approach is from the record of the moves, not from a name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from bench.methods.indexing.names import CLOCKING, PASS, REVERSE, VERIFICATION
from bench.methods.indexing.reduction.sweep import SweepRecord
from bench.metrology.acquisition import Acquisition, Counts, Mount, Output
from bench.metrology.bench_uncertainty import BenchRecord
from bench.metrology.least_squares import Array
from bench.metrology.orientation import unit_axes
from bench.metrology.outputs import STABLE_PART_S, mean_output, measured, steadiness
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import RunData, UnitUnderTest

OTHER_SIDE = {"below": "above", "above": "below", "": ""}
UPRIGHT = 0.5  # sine of the smallest angle of an input axis above the level at which it is not the one measured
NOT_TURNED = 0.5  # cosine of the angle between an input axis and that of the head, from which the head does not turn it
CLOCK_DIGITS = 6  # decimals of a clocking in °; those of a bench file have fewer
TURN_DEG = 1e-3  # finite difference of the head angle, for derivatives

Kind = Literal["sweep", "clocking", "verification"]
Face = Literal["Y", "Z"]


@dataclass(frozen=True, slots=True)
class IndexingReading:
    """One reading: its output in the unit of the channel, NaN if unusable.

    `angle_rad` is the angle of the input axis above the horizontal, by the angles of the table alone, `head_rad` that
    of the head; `turn` is the change of sin(angle) for 1 rad of the head. `face` is the axis of the unit that is
    vertical at 0°, Z on its ends and Y on its sides, and `end` where it points: up or down. `number` counts all
    readings of the run, `stand` the preceding moves. `came_from` is the side of approach of the head, `side` that of
    the input, "below" or "above", empty if unknown. `single_u` is the single-reading uncertainty, `quantisation_u` the
    quantisation uncertainty of codes. `run_share` is its position in the run, from -½ to ½.
    """

    number: int
    step: str
    kind: Kind
    attempt: int
    face: Face
    end: str
    direction: str
    angle_rad: float
    head_rad: float
    turn: float
    clock_rad: float
    output: float
    stable: bool
    temperature_c: float
    single_u: float = 0.0
    quantisation_u: float = 0.0
    came_from: str = ""
    side: str = ""
    stand: int = 0
    run_share: float = 0.0


def readings_of(data: RunData, unit: UnitUnderTest) -> tuple[list[IndexingReading], list[Flag]]:
    """All readings of a unit in run order, and flags for those that cannot be used.

    Of a channel of an instrument with several, those in which its input axis is neither upright nor that of the head:
    in the others another channel is measured.
    """
    flat = replace(data.bench, level_deg=0.0)
    elsewhere = _of_other_channels(data.acquisitions, unit, flat)
    found, flags = [], []
    for number, acquisition in enumerate(data.acquisitions):
        kind, along_head = (
            kind_of(acquisition.step),
            float(unit_axes(acquisition, unit, flat)[0] @ np.array(flat.head.points)),
        )
        if acquisition.mount in elsewhere or (kind != "clocking" and abs(along_head) > NOT_TURNED):
            continue
        output = mean_output(acquisition, unit)
        flags += [Flag(problem, at=acquisition.step) for problem in output.problems]
        usable = not set(output.problems) - {"unstable"}
        axes, turned = (unit_axes(each, unit, flat)[:, 2] for each in (acquisition, _turned(acquisition, flat)))
        temperature_c = acquisition.temperatures_c[unit.temperature]
        turn = float((turned[0] - axes[0]) / np.radians(TURN_DEG))
        face: Face = "Z" if abs(axes[2]) >= abs(axes[1]) else "Y"
        came_from = acquisition.came_from.get(next(iter(data.bench.axes), ""), "")
        reading = IndexingReading(
            number=number,
            step=acquisition.step,
            kind=kind,
            attempt=int(acquisition.loops.get(PASS, 1)),
            face=face,
            end="up" if axes[2 if face == "Z" else 1] > 0 else "down",
            direction="rev" if REVERSE in acquisition.loops else "fwd",
            angle_rad=float(np.arcsin(np.clip(axes[0], -1, 1))),
            head_rad=float(np.radians(acquisition.angle_deg)),
            turn=turn,
            clock_rad=float(np.radians(round(np.degrees(np.arctan2(-along_head, turn)) % 360, CLOCK_DIGITS) % 360)),
            output=output.value if usable else float("nan"),
            stable="unstable" not in output.problems,
            temperature_c=float(np.mean(temperature_c)) if len(temperature_c) else float("nan"),
            single_u=_single_u(acquisition, unit, output) if usable else 0.0,
            quantisation_u=output.quantisation_u if usable else 0.0,
            came_from=came_from,
            side=came_from if turn > 0 else OTHER_SIDE[came_from],
            stand=acquisition.stand,
            run_share=float(data.run_share(np.array([(acquisition.begin_s + acquisition.end_s) / 2]))[0]),
        )
        found.append(reading)
    return found, flags


def _of_other_channels(acquisitions: Sequence[Acquisition], unit: UnitUnderTest, bench: BenchRecord) -> set[Mount]:
    """Mounts in which the input axis of a unit is never near the level."""
    nearest: dict[Mount, float] = {}
    for each in acquisitions:
        along = abs(float(unit_axes(each, unit, bench)[0, 2]))
        nearest[each.mount] = min(nearest.get(each.mount, 1.0), along)
    return {mount for mount, along in nearest.items() if along > UPRIGHT}


def _single_u(acquisition: Acquisition, unit: UnitUnderTest, output: Output) -> float:
    """Single-reading standard uncertainty, at least that from the scatter of the parts of 10 s.

    Variations of the zero within seconds scatter these more than independent samples would. Parts of a count share its
    resolution, so that it has the uncertainty of the resolution only.
    """
    found, over_s = measured(acquisition, unit), acquisition.over_s
    steady = None if over_s is None or isinstance(found, Counts) else steadiness(found, over_s)
    if over_s is None or steady is None:
        return output.single_u
    return float(max(output.single_u, steady[0] / np.sqrt(round(over_s / STABLE_PART_S))))


def _turned(acquisition: Acquisition, bench: BenchRecord) -> Acquisition:
    """The same acquisition with the head turned by a finite difference."""
    head = next(iter(bench.axes), "")
    angles_deg: Mapping[str, float] = {**acquisition.angles_deg, head: acquisition.angle_deg + TURN_DEG}
    return replace(acquisition, angles_deg=angles_deg)


def kind_of(step: str) -> Kind:
    """Purpose of a reading, by the id of its step."""
    parts = step.split("/")
    return "clocking" if CLOCKING in parts else "verification" if VERIFICATION in parts else "sweep"


def sweep_record(readings: Sequence[IndexingReading]) -> SweepRecord:
    """Readings as a record of sweeps; columns named V are in the unit of the output."""
    return SweepRecord(
        end=np.array([each.end for each in readings], dtype=np.str_),
        direction=np.array([each.direction for each in readings], dtype=np.str_),
        sequence=np.array([each.number for each in readings], dtype=np.float64),
        angle_deg=np.degrees([each.angle_rad for each in readings]),
        output_v=np.array([each.output for each in readings], dtype=np.float64),
        stable=np.array([each.stable for each in readings], dtype=np.bool_),
        temperature_c=np.array([each.temperature_c for each in readings], dtype=np.float64),
        side=np.array([each.side for each in readings], dtype=np.str_),
        stand=np.array([each.stand for each in readings], dtype=np.int_),
    )


def usable_clocking(readings: Sequence[IndexingReading], output_limit: float) -> list[IndexingReading]:
    """Clocking readings that can be fitted."""
    return [each for each in readings if each.stable and np.isfinite(each.output) and abs(each.output) < output_limit]


def clocking_arrays(readings: Sequence[IndexingReading]) -> tuple[Array, Array] | None:
    """Angles in rad and outputs; None without any."""
    if not readings:
        return None
    return np.array([each.clock_rad for each in readings]), np.array([each.output for each in readings])
