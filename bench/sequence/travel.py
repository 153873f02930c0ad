"""Where the axes of a bench stand before each step of a plan: angles as the encoder counts them, over whole turns."""

from __future__ import annotations

import math
from collections.abc import Iterator

from bench.sequence.plan import Alternatives, Attempts, Branches, Meanwhile, Nodes, Passes, Plan, PlannedStep, Section
from bench.sequence.stimulus import Move, Rotate

PASSES_LOOKED_AT = 1000  # of a loop whose end is measured; what travels further is told by then


def angles_before(plan: Plan) -> Iterator[tuple[PlannedStep, float]]:
    """Each step with the angle of its axis before it, in °; 0 for steps without one.

    Axes begin at 0. Of alternatives both are gone through, one after the other, from the same angle; a loop whose end
    is measured is gone through as often as it may be.
    """
    yield from _Travel({}).nodes((*plan.setup, *plan.steps, *plan.teardown))


class _Travel:
    def __init__(self, angles_deg: dict[str, float]) -> None:
        self._angles_deg = angles_deg

    def nodes(self, nodes: Nodes) -> Iterator[tuple[PlannedStep, float]]:
        for node in nodes:
            match node:
                case PlannedStep():
                    yield self._step(node)
                case Meanwhile():
                    yield self._step(node.step)
                    yield from self.nodes(node.body)
                case Section():
                    yield from self.nodes(node.body)
                    yield from self.nodes(node.teardown)
                case Alternatives():
                    before = dict(self._angles_deg)
                    yield from self.nodes(node.then)
                    after, self._angles_deg = self._angles_deg, before
                    yield from self.nodes(node.otherwise)
                    self._angles_deg = {**after, **self._angles_deg}
                case Passes():
                    yield from self._passes(node)
                case Attempts():
                    yield from self.nodes(node.body)
                case Branches():
                    for branch in node.branches.values():
                        yield from self.nodes(branch)

    def _passes(self, node: Passes) -> Iterator[tuple[PlannedStep, float]]:
        """As many passes as there may be; no more once a pass ends where it began."""
        for number in range(1, min(node.at_most, PASSES_LOOKED_AT) + 1):
            before = dict(self._angles_deg)
            yield from self.nodes(node.numbered(number))
            if before == self._angles_deg:
                return

    def _step(self, planned: PlannedStep) -> tuple[PlannedStep, float]:
        """The step and where its axis stood; keeps where it goes."""
        step = planned.step
        from_deg = self._angles_deg.get(getattr(step, "role", ""), 0.0)
        if isinstance(step, Move):
            target_deg = step.target_deg(from_deg)
            self._angles_deg[step.role] = from_deg if math.isnan(target_deg) else target_deg
        elif isinstance(step, Rotate) and step.during is None:
            self._angles_deg[step.role] = from_deg + math.copysign(step.least_s * abs(step.rate_dps), step.rate_dps)
        return planned, from_deg
