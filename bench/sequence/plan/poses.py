"""Angles of the axes of a bench before each step of a plan, as read by the encoder, including whole turns."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from bench.config.models import BenchFile
from bench.sequence.plan.plan import Alternatives, Meanwhile, Nodes, Passes, Plan, PlannedStep, within
from bench.sequence.steps.orienting import Orient, Pose, Turning, Unreachable
from bench.sequence.steps.stimulus import Move, Rotate
from bench.sequence.steps.talk import Prompt
from bench.sequence.steps.verbs import Step

# passes of a loop with a measured end; an axis that moves beyond its limits has done so by then
PASSES_LOOKED_AT = 1000


def first_input_deg(head_deg: float, bench: BenchFile) -> float:
    """Angle of the input axis of the first place above the horizontal at a head angle, in °."""
    axis = bench.fixture.input_axis
    return (head_deg if axis is None else axis.input_deg(head_deg)) + next(iter(bench.places.values())).mount_angle


def angles_before(plan: Plan, bench: BenchFile | None = None) -> Iterator[tuple[PlannedStep, float]]:
    """Each step with the angle of its axis before it, in °; 0 for steps without one.

    Without a bench the angles of a table for an attitude are unknown.
    """
    for planned, pose in poses_before(plan, bench):
        yield planned, pose.angles_deg.get(_role(planned.step), 0.0)


def poses_before(plan: Plan, bench: BenchFile | None) -> Iterator[tuple[PlannedStep, Pose]]:
    """Each step with the angles of the axes before it, and the mount of the units.

    Axes begin at 0. Both alternatives are passed, one after the other, from the same angles; a loop with a
    measured end is passed its maximum number of times.
    """
    yield from _Travel(bench).nodes((*plan.setup, *plan.steps, *plan.teardown))


def _role(step: Step) -> str:
    """Device of a step; "" for a step without one."""
    role: str = vars(step).get("role", "")  # getattr of a key that a model lacks is slow
    return role


class _Travel:
    def __init__(self, bench: BenchFile | None) -> None:
        self._turning = None if bench is None else Turning(bench)
        self._angles_deg: Mapping[str, float] = {}  # never changed: many poses share it
        self._mount: str | None = None

    def nodes(self, nodes: Nodes) -> Iterator[tuple[PlannedStep, Pose]]:
        for node in nodes:
            if isinstance(node, PlannedStep):
                yield self._step(node)
            elif isinstance(node, Alternatives):
                before = self._angles_deg
                yield from self.nodes(node.then)
                after, self._angles_deg = self._angles_deg, before
                yield from self.nodes(node.otherwise)
                self._angles_deg = {**after, **self._angles_deg}
            elif isinstance(node, Passes):
                yield from self._passes(node)
            else:
                if isinstance(node, Meanwhile):
                    yield self._step(node.step)
                for inner in within(node):
                    yield from self.nodes(inner)

    def _passes(self, node: Passes) -> Iterator[tuple[PlannedStep, Pose]]:
        """Maximum number of passes; fewer if a pass ends where it began."""
        for number in range(1, min(node.at_most, PASSES_LOOKED_AT) + 1):
            before = self._angles_deg
            yield from self.nodes(node.numbered(number))
            if before == self._angles_deg:
                return

    def _step(self, planned: PlannedStep) -> tuple[PlannedStep, Pose]:
        """The step and the pose before it; stores the pose after it."""
        step, pose = planned.step, Pose(self._angles_deg, self._mount)
        if isinstance(step, Move):
            from_deg = self._angle_deg(step.role)
            target_deg = step.target_deg(from_deg)
            self._turn({step.role: from_deg if math.isnan(target_deg) else target_deg})
        elif isinstance(step, Rotate) and step.during is None:
            way_deg = math.copysign(step.least_s * abs(step.rate_dps), step.rate_dps)
            self._turn({step.role: self._angle_deg(step.role) + way_deg})
        elif isinstance(step, Orient) and self._turning is not None:
            self._orient(step, self._turning, pose)
        elif isinstance(step, Prompt) and step.expect is not None and step.expect.mount is not None:
            self._mount = step.expect.mount
        return planned, pose

    def _orient(self, step: Orient, turning: Turning, pose: Pose) -> None:
        """Pose after an attitude; an unreachable one changes nothing and is reported elsewhere."""
        try:
            self._turn(turning.targets_deg(step.attitude, pose))
        except Unreachable:
            return

    def _angle_deg(self, role: str) -> float:
        return self._angles_deg.get(role, 0.0)

    def _turn(self, angles_deg: Mapping[str, float]) -> None:
        self._angles_deg = {**self._angles_deg, **angles_deg}
