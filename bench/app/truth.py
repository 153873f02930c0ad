"""Truth of a simulated run, computed by the simulators from the record of the run.

It uses times, temperatures and attitudes of the record, but no code of a reduction, whose errors would otherwise be in
the truth too. An import contract ensures that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from bench.app.laboratory import Laboratory
from bench.metrology.acquisition import Acquisition
from bench.reduce.stored_run import StoredRun
from bench.sequence.method import CountsAt, known_methods
from drivers.installed import loaded
from simulators.physics.attitude import Mount
from simulators.truth.channel import LevelAsMeasured, levels_record
from simulators.truth.constants import DwellAsMeasured, LegAsMeasured, Orientation, truth_record, turning_record
from simulators.truth.imu import WindowAsMeasured, imu_record
from simulators.truth.ladder import LadderAsMeasured, ladders_record
from simulators.world import World


def truth_of(stored: StoredRun, laboratory: Laboratory) -> dict[str, Any]:
    """Return the content of truth.json, which no reduction reads. Raises StoreError for an unreadable record."""
    world = laboratory.world
    truth = truth_record(world, _dwells(stored), _legs(stored), laboratory.voltmeters, _readings(stored))
    truth |= ladders_record(world, _ladders(stored))
    truth |= levels_record(world, _levels(stored))
    truth |= turning_record(world, list(_on_a_table(stored)))
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


class _Measured(NamedTuple):
    """An acquisition of one unit; `temperature` and `source` are the names of its inputs in the record."""

    label: str
    place: str
    temperature: str
    source: str
    acquired: Acquisition
    sensors: tuple[str, ...]

    def key(self, step: str) -> str:
        """Return the key of a step, or of a group of steps, in the truth."""
        return f"{self.label}/{self.place}@{step}"


def _each(stored: StoredRun, counted_at: CountsAt) -> Iterator[_Measured]:
    """Yield the acquisitions of methods with this kind of counting, in the order of the record."""
    for data in stored.counted_at(counted_at):
        for unit in data.units:
            for acquired in data.acquisitions:
                sensors = tuple(name for name in unit.channels if name.startswith("acc_")) or ("",)
                yield _Measured(data.label, unit.place, unit.temperature, unit.source, acquired, sensors)


def _by(
    stored: StoredRun, counted_at: CountsAt, belongs_to: Callable[[Acquisition], str]
) -> dict[str, list[_Measured]]:
    """Return the same acquisitions by what those of a unit belong to, with its keys in the truth."""
    found: dict[str, list[_Measured]] = {}
    for each in _each(stored, counted_at):
        found.setdefault(each.key(belongs_to(each.acquired)), []).append(each)
    return found


def orientation(acquisition: Acquisition) -> Orientation:
    """Return the orientation of a unit as the bench knows it: angles of the table, and mount."""
    mount = acquisition.mount
    angles_deg = tuple(acquisition.angles_deg.values()) or (0.0,)
    return Orientation(angles_deg, Mount(mount.angle_deg, mount.roll_deg, mount.clock_deg))


def _middle_s(acquisition: Acquisition) -> float:
    return (acquisition.begin_s + acquisition.end_s) / 2


def _dwells(stored: StoredRun) -> list[DwellAsMeasured]:
    """Return the dwells of a run for the truth: times, temperatures and angles."""
    dwells = _by(stored, "dwells", lambda acquired: acquired.group.partition("/")[2])
    return [_dwell(key, members[0], [each.acquired for each in members]) for key, members in dwells.items()]


def _dwell(key: str, first: _Measured, members: Sequence[Acquisition]) -> DwellAsMeasured:
    return DwellAsMeasured(
        key=key,
        place=first.place,
        at_s=math.fsum(member.begin_s + member.end_s for member in members) / (2 * len(members)),
        temperature_c=math.fsum(each.temperatures_c[first.temperature].mean() for each in members) / len(members),
        orientation=tuple(orientation(member) for member in members),
        each_s=tuple(_middle_s(member) for member in members),
    )


def _windows(stored: StoredRun) -> Iterator[WindowAsMeasured]:
    """Yield the windows of a run for each inertial unit."""
    for each in _each(stored, "windows"):
        yield WindowAsMeasured(each.key(each.acquired.step), each.place, _middle_s(each.acquired))


def _on_a_table(stored: StoredRun) -> Iterator[LegAsMeasured]:
    """Yield the acquisitions of each unit on a rate table, by step."""
    for each in _each(stored, "table"):
        yield replace(_leg(each, each.acquired.begin_s), key=each.acquired.step)


def _readings(stored: StoredRun) -> list[LegAsMeasured]:
    """Return the single readings of methods that count separately: the last stable reading of each unit."""
    return [
        _leg(each, each.acquired.end_s - (each.acquired.over_s or each.acquired.end_s - each.acquired.begin_s))
        for each in _each(stored, "records")
    ]


def _legs(stored: StoredRun) -> list[LegAsMeasured]:
    """Return the legs of temperature ramps, one acquisition each."""
    return [_leg(each, each.acquired.begin_s) for each in _each(stored, "ramps")]


def _leg(each: _Measured, begin_s: float) -> LegAsMeasured:
    acquired = each.acquired
    return LegAsMeasured(each.key(acquired.step), each.place, begin_s, acquired.end_s, orientation(acquired))


def _levels(stored: StoredRun) -> list[LevelAsMeasured]:
    """Return the acquisitions at one input level each; of an inertial unit one for each accelerometer."""
    return [
        LevelAsMeasured(
            _level_key(each, sensor), each.place, level.begin_s, level.end_s, orientation(level),
            source_a=_source_a(each, sensor), sensor=sensor,
        )
        for each in _each(stored, "levels") for level in (each.acquired,) for sensor in each.sensors
    ]  # fmt: skip


def _level_key(each: _Measured, sensor: str) -> str:
    place = f"{each.place}/{sensor.removeprefix('acc_')}" if sensor else each.place
    return f"{each.label}/{place}@{each.acquired.step}"


def _source_a(each: _Measured, sensor: str) -> float | None:
    """Return the set current into a converter; None with its accelerometer connected."""
    level = each.acquired
    if level.input != "source":
        return None
    return level.sources_set_a.get(each.source, 0.0) if level.input_channel == sensor else 0.0


def _ladders(stored: StoredRun) -> list[LadderAsMeasured]:
    """Return the ladders of small steps, by the loop variable `position`; their position is that of the start."""
    ladders = _by(stored, "steps", lambda acquired: f"position={acquired.loops.get('position', 0.0):g}")
    return [
        LadderAsMeasured(
            key=key,
            place=steps[0].place,
            at_s=(steps[0].acquired.begin_s + steps[-1].acquired.end_s) / 2,
            orientation=orientation(steps[0].acquired),
        )
        for key, steps in ladders.items()
    ]
