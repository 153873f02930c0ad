"""Results of an inertial unit from those of its three accelerometer channels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain

from bench.methods.channel.reduction.levels import input_level
from bench.metrology.results.finding import UnitResult
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import RunData, UnitUnderTest

NOT_MEASURED = "channel_not_measured"


@dataclass(frozen=True, slots=True)
class InertialDetail:
    """Data for the report: those of each channel, by its axis."""

    channels: Mapping[str, object]


def combined(
    data: RunData, unit: UnitUnderTest, found: Mapping[str, UnitResult], wrong: Mapping[str, Flag]
) -> UnitResult:
    """Results of an inertial unit; `found` are those of its channels by axis, `wrong` the acquisitions left out.

    A channel without a result, and one whose acquisition is left out, make the unit incomplete.
    """
    every = found.values()
    not_measured = [axis for axis, result in found.items() if not result.findings]
    left_out = [f"{axis}/{part}" for axis, result in found.items() for part in result.left_out]
    common = {"converter", unit.source, unit.ammeter}
    flags = [_of_axis(axis, flag, common) for axis, result in found.items() for flag in result.flags]
    return UnitResult(
        place=unit.place,
        uut=unit.serial,
        findings=tuple(chain.from_iterable(each.findings for each in every)),
        models=tuple(chain.from_iterable(each.models for each in every)),
        compensations=tuple(chain.from_iterable(each.compensations for each in every)),
        left_out=tuple(dict.fromkeys([*_levels_left_out(data, unit, wrong), *left_out, *not_measured])),
        flags=(
            *_once_each(wrong.values()),
            *(Flag(NOT_MEASURED, of=f"acc_{axis}") for axis in not_measured),
            *dict.fromkeys(flags),
        ),
        detail=InertialDetail({axis: result.detail for axis, result in found.items()}),
    )


def _once_each(flags: Iterable[Flag]) -> Iterable[Flag]:
    """The first flag of each set-up: its ramp and its points at rest contradict the record alike."""
    found: dict[tuple[object, ...], Flag] = {}
    for flag in flags:
        of_setup = (flag.values.get(name) for name in ("mount", "axis", "channel", "found", "level"))
        found.setdefault((flag.code, *of_setup), flag)
    return found.values()


def _levels_left_out(data: RunData, unit: UnitUnderTest, wrong: Mapping[str, Flag]) -> Iterator[str]:
    """Levels of channels that acquisitions with a wrong input were to be of; the step where there are none."""
    for acquisition in data.acquisitions:
        if acquisition.step in wrong:
            levels = {each.axis: input_level(data, each, acquisition) for each in unit.accelerometers}
            yield from (f"{axis}/{level.name}" for axis, level in levels.items() if level is not None)


def _of_axis(axis: str, flag: Flag, common: set[str]) -> Flag:
    """A flag of a channel with its axis, unless it is on something that all channels share."""
    if flag.of:
        return flag if flag.of in common else replace(flag, of=f"{axis}/{flag.of}")
    return replace(flag, at=f"{axis}/{flag.at}" if flag.at else axis)
