"""Input levels of the channels of an inertial unit in the ramps of a plan, by the mounts and prompts of its steps."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from bench.config.fixture import Mount
from bench.config.models import BenchFile
from bench.config.places import ACCELEROMETERS, PlaceEntry
from bench.methods.channel.level_names import level_name
from bench.sequence.checks.acquired import ramps_during
from bench.sequence.plan.plan import Plan
from bench.sequence.plan.poses import poses_before
from bench.sequence.steps.stimulus import SetOutput
from bench.sequence.steps.talk import Prompt

LEAST_LEVEL_G = 0.1  # along the axis of a channel that is not level


@dataclass(slots=True)
class _Inputs:
    """Inputs of the converters at a step: the channel of the source's cable, and what each source is set to, in g."""

    by_source: bool = False
    channel: str = ""
    set_g: dict[str, float] = field(default_factory=dict)


def planned_levels(plan: Plan, bench: BenchFile, place: PlaceEntry, label: str) -> Mapping[str, set[str]]:
    """Names of the levels of each accelerometer channel of an inertial unit in the ramps under a label.

    On a slab: the axes of a table are taken to stand at 0°.
    """
    ramped = {planned.id.rpartition("/")[0] for planned, _, _ in ramps_during(plan, label)}
    inputs = _Inputs()
    found: dict[str, set[str]] = {sensor: set() for sensor in ACCELEROMETERS}
    for planned, pose in poses_before(plan, bench):
        step = planned.step
        if isinstance(step, Prompt) and step.expect is not None and step.expect.input is not None:
            inputs.by_source, inputs.channel = step.expect.input == "source", step.expect.fed_channel
        elif isinstance(step, SetOutput):
            inputs.set_g[step.role] = step.acceleration_g or 0.0
        elif planned.id in ramped:
            for sensor, level in _levels(bench, place, bench.fixture.mount(pose.mount), inputs):
                found[sensor].add(level)
    return found


def _levels(bench: BenchFile, place: PlaceEntry, mount: Mount, inputs: _Inputs) -> Iterator[tuple[str, str]]:
    if inputs.by_source:
        if inputs.channel in ACCELEROMETERS:
            yield inputs.channel, level_name(inputs.set_g.get(place.source or "", 0.0), by_source=True)
        return
    for sensor, level_g in zip(ACCELEROMETERS, _upward(bench, mount, place.mount_angle), strict=True):
        if abs(level_g) >= LEAST_LEVEL_G:
            yield sensor, level_name(level_g, by_source=False)


def _upward(bench: BenchFile, mount: Mount, own_deg: float) -> tuple[float, float, float]:
    """Components of up along x, y and z of a unit in a mount: raised, rolled, clocked, raised in its place."""
    x_axis, z_axis = bench.fixture.x, bench.fixture.z
    x, z = x_axis[2], z_axis[2]
    y = z_axis[0] * x_axis[1] - z_axis[1] * x_axis[0]
    x, z = _turned(x, z, mount.angle)
    y, z = _turned(y, z, mount.roll)
    x, y = _turned(x, y, mount.clock)
    x, z = _turned(x, z, own_deg)
    return x, y, z


def _turned(first: float, second: float, angle_deg: float) -> tuple[float, float]:
    cosine, sine = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return cosine * first + sine * second, cosine * second - sine * first
