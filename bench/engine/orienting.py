"""Move the axes of a table until the units have the attitude of a step."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any

from bench.engine.context import Bench
from bench.errors import StepError
from bench.sequence.plan.motion import Side, came_from
from bench.sequence.steps.orienting import Orient, Pose, Unreachable, targets_deg


async def orient(step: Orient, bench: Bench) -> Mapping[str, Any]:
    """Move one axis after the other, the outer first; an axis already at its target is not moved."""
    pose = Pose({role: await _angle_deg(role, bench) for role in bench.file.axes}, bench.journal.state.mount)
    try:
        targets = targets_deg(step.attitude, bench.file, pose)
    except Unreachable as problem:
        raise StepError(f"{problem}. Nothing was sent.") from None
    stands_deg: dict[str, float] = {}
    sides: dict[str, Side] = {}
    for role, target_deg in targets.items():
        if target_deg == pose.angles_deg[role]:
            continue
        bench.angles_deg.pop(role, None)
        reading = await bench.rig.positioner(role).move_to(target_deg, approach=step.approach, settle_s=0.0)
        bench.angles_deg[role], stands_deg[role] = target_deg, reading.value
        if (side := came_from(step.approach, pose.angles_deg[role], target_deg)) is not None:
            sides[role] = side
    await asyncio.sleep(step.settle_s)
    return {"attitude": str(step.attitude), "angles_deg": stands_deg, "came_from": sides}


async def stop_axes(bench: Bench) -> None:
    """Stop every axis of the table."""
    for role in bench.file.axes:
        await bench.rig.positioner(role).stop()


async def _angle_deg(role: str, bench: Bench) -> float:
    """Target of the last move or, if unknown, the present angle of the axis."""
    if role not in bench.angles_deg:
        return (await bench.rig.positioner(role).angle()).value
    return bench.angles_deg[role]
