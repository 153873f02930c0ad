"""Truth of a simulated run, computed by the simulators from the record of the run.

It uses times, temperatures and attitudes of the record, but no code of a reduction, whose errors would otherwise be in
the truth too. An import contract ensures that.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from bench.app.laboratory import Laboratory
from bench.metrology.acquisition import Acquisition
from bench.metrology.run_data import UnitUnderTest
from bench.reduce.stored_run import StoredRun
from bench.sequence.method import CountsAt, known_methods
from drivers.installed import loaded
from simulators.physics.attitude import Mount
from simulators.truth.channel import LevelAsMeasured, levels_record
from simulators.truth.constants import DwellAsMeasured, LegAsMeasured, Lies, truth_record
from simulators.truth.imu import WindowAsMeasured, imu_record
from simulators.truth.ladder import LadderAsMeasured, ladders_record
from simulators.world import World


def truth_of(stored: StoredRun, laboratory: Laboratory) -> dict[str, Any]:
    """Return the content of truth.json, which no reduction reads. Raises StoreError for an unreadable record."""
    world = laboratory.world
    truth = truth_record(world, _dwells(stored), _legs(stored), laboratory.voltmeters, _readings(stored))
    truth |= ladders_record(world, _ladders(stored))
    truth |= levels_record(world, _levels(stored))
    if world.imus:
        truth |= imu_record(world, list(_windows(stored)))
    return truth | _own_truth(stored, world)


def _own_truth(stored: StoredRun, world: World) -> dict[str, Any]:
    """Return the truth that methods compute themselves, by method and label; empty without such methods."""
    found: dict[str, dict[str, Any]] = {}
    for entry in stored.sequence.results:
        target = known_methods()[entry.method].truth
        if target:
            found.setdefault(entry.method, {})[entry.data] = loaded(target)(stored.data(entry.data), world)
    return {"methods": found} if found else {}


def _each(stored: StoredRun, counted_at: CountsAt) -> Iterator[tuple[str, UnitUnderTest, Acquisition]]:
    """Yield the acquisitions of methods with this kind of counting, with their keys in the truth."""
    for data in stored.counted_at(counted_at):
        for unit in data.units:
            for acquisition in data.acquisitions:
                yield f"{data.label}/{unit.place}@{acquisition.step}", unit, acquisition


def orientation(acquisition: Acquisition) -> Lies:
    """Return the orientation of a unit as the bench knows it: angles of the table, and mount."""
    mount = acquisition.mount
    angles_deg = tuple(acquisition.angles_deg.values()) or (0.0,)
    return Lies(angles_deg, Mount(mount.angle_deg, mount.roll_deg, mount.clock_deg))


def _dwells(stored: StoredRun) -> list[DwellAsMeasured]:
    """Return the dwells of a run for the truth: times, temperatures and angles."""
    found = []
    for data in stored.counted_at("dwells"):
        for unit in data.units:
            found += [_dwell(data.label, unit, group, members) for group, members in data.groups().items()]
    return found


def _dwell(label: str, unit: UnitUnderTest, group: str, members: Sequence[Acquisition]) -> DwellAsMeasured:
    return DwellAsMeasured(
        key=f"{label}/{unit.place}@{group.partition('/')[2]}",
        place=unit.place,
        at_s=math.fsum(member.begin_s + member.end_s for member in members) / (2 * len(members)),
        temperature_c=math.fsum(each.temperatures_c[unit.temperature].mean() for each in members) / len(members),
        lies=tuple(orientation(member) for member in members),
        each_s=tuple((member.begin_s + member.end_s) / 2 for member in members),
    )


def _windows(stored: StoredRun) -> Iterator[WindowAsMeasured]:
    """Yield the windows of a run for each inertial unit."""
    for key, unit, window in _each(stored, "windows"):
        yield WindowAsMeasured(key, unit.place, (window.begin_s + window.end_s) / 2)


def _readings(stored: StoredRun) -> list[LegAsMeasured]:
    """Return the single readings of methods that count separately: the last stable reading of each unit."""
    return [
        LegAsMeasured(
            key, unit.place, each.end_s - (each.over_s or each.end_s - each.begin_s), each.end_s, orientation(each)
        )
        for key, unit, each in _each(stored, "records")
    ]


def _legs(stored: StoredRun) -> list[LegAsMeasured]:
    """Return the legs of temperature ramps, one acquisition each."""
    return [
        LegAsMeasured(key, unit.place, leg.begin_s, leg.end_s, orientation(leg))
        for key, unit, leg in _each(stored, "ramps")
    ]


def _levels(stored: StoredRun) -> list[LevelAsMeasured]:
    """Return the acquisitions at one input level each."""
    return [
        LevelAsMeasured(
            key, unit.place, level.begin_s, level.end_s, orientation(level),
            source_a=level.sources_told_a.get(unit.source, 0.0) if level.input == "source" else None,
        )
        for key, unit, level in _each(stored, "levels")
    ]  # fmt: skip


def _ladders(stored: StoredRun) -> list[LadderAsMeasured]:
    """Return the ladders of small steps; their position is that of the start."""
    return [
        LadderAsMeasured(
            key=f"{data.label}/{unit.place}@position={position:g}",
            place=unit.place,
            at_s=(members[0].begin_s + members[-1].end_s) / 2,
            lies=orientation(members[0]),
        )
        for data in stored.counted_at("steps")
        for unit in data.units
        for position, members in _ladders_of(data.acquisitions).items()
    ]


def _ladders_of(acquisitions: Sequence[Acquisition]) -> dict[float, list[Acquisition]]:
    """Return the acquisitions of each ladder, by the loop variable `position`."""
    found: dict[float, list[Acquisition]] = {}
    for acquisition in acquisitions:
        found.setdefault(acquisition.loops.get("position", 0.0), []).append(acquisition)
    return found
