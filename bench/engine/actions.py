"""One short function for each kind of step, and the stop of what an interrupted step has started."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, assert_never

from bench.engine import measuring, recording, steadiness, waiting
from bench.engine.context import Bench, Found
from bench.engine.questions import Question
from bench.errors import StepError
from bench.sequence.plan.motion import Side, came_from
from bench.sequence.steps.custom import Custom, known_steps
from bench.sequence.steps.fields import is_known
from bench.sequence.steps.measuring import Acquire, Measure, Tare
from bench.sequence.steps.orienting import Orient, Pose, Turning, Unreachable
from bench.sequence.steps.stimulus import Move, Oscillate, Ramp, Rotate, SetOutput
from bench.sequence.steps.talk import Alarm, Note, Prompt
from bench.sequence.steps.verbs import Step
from bench.sequence.steps.waits import Soak, Wait, WaitUntil
from drivers.capabilities import Positioner, SweepingTable
from drivers.errors import DriverError
from drivers.installed import loaded
from drivers.quantity.quantities import Quantity
from drivers.quantity.units import customary_unit


async def perform(step: Step, step_id: str, bench: Bench) -> Found:  # noqa: C901  one case for each kind of step
    """Execute a step; return its result for the journal."""
    match step:
        case Move():
            return await _move(step, bench)
        case Orient():
            return await orient(step, bench)
        case Rotate():
            return await _rotate(step, bench)
        case Oscillate():
            return await _oscillate(step, bench)
        case SetOutput():
            return await _set_output(step, bench)
        case Ramp():
            await bench.rig.chamber(step.role).ramp_to(step.temperature_c, step.rate_c_per_min)
            return {"set_point_c": step.temperature_c}
        case Wait():
            await asyncio.sleep(step.duration_s)
            return {}
        case WaitUntil() if step.steady is not None:
            return await steadiness.until_steady(step, bench)
        case WaitUntil():
            return await waiting.until(step, bench.monitor)
        case Soak():
            return await waiting.soak(step, bench.monitor, _credit_s(step, step_id, bench))
        case Acquire():
            return await recording.acquire(step, step_id, bench)
        case Measure():
            return await measuring.measure(step, step_id, bench)
        case Tare():
            return await measuring.tare(step, step_id, bench)
        case Prompt():
            return await _ask(step, step_id, bench)
        case Note():
            bench.notice(step.text)
            return {"note": step.text}
        case Alarm():
            bench.notice(f"\a*** {step.text} ***")
            return {"alarm": step.text}
        case Custom():
            return await _custom(step, bench)
        case _:
            assert_never(step)


def target_of(step: Step, bench: Bench) -> Found:
    """Return the target of a step, for the journal before the step begins.

    A movement relative to an angle that is not known yet has no target.
    """
    match step:
        case Move():
            from_deg = bench.angles_deg.get(step.role)
            if from_deg is None and (step.by_deg is not None or step.way != "as_written"):
                return {"device": step.role}
            return {"device": step.role, "target_deg": step.target_deg(from_deg or 0.0)}
        case Orient():
            return {"attitude": str(step.attitude)}
        case Rotate():
            return {"device": step.role, "rate_dps": step.rate_dps}
        case Oscillate():
            return {"device": step.role, "amplitude_deg": step.amplitude_deg}
        case Ramp():
            return {"device": step.role, "target_c": step.temperature_c, "rate_c_per_min": step.rate_c_per_min}
        case SetOutput():
            levels = {"voltage_v": step.voltage_v, "current_a": step.current_a, "acceleration_g": step.acceleration_g}
            return {"device": step.role, "output": step.output, **{k: v for k, v in levels.items() if v is not None}}
        case _:
            return {}


async def leave(step: Step, bench: Bench) -> None:
    """Stop the motion or output that an interrupted step has started."""
    match step:
        case Move():
            await bench.rig.positioner(step.role).stop()
        case Orient():
            await stop_axes(bench)
        case Rotate() | Oscillate():
            await bench.rig.table(step.role).stop()
        case Ramp():
            await bench.rig.chamber(step.role).hold()
        case _:
            pass


async def _move(step: Move, bench: Bench) -> Found:
    head = bench.rig.positioner(step.role)
    from_deg = bench.angles_deg.get(step.role)
    if from_deg is None and (step.by_deg is not None or step.way != "as_written"):
        from_deg = (await head.angle()).value
    target_deg = step.target_deg(from_deg or 0.0)
    bench.angles_deg.pop(step.role, None)
    reading = await head.move_to(target_deg, approach=step.approach, settle_s=step.settle_s)
    bench.angles_deg[step.role] = target_deg
    side = came_from(step.approach, from_deg, target_deg)
    return {"device": step.role, "angle_deg": reading.value, **({"came_from": side} if side else {})}


async def begin_turning(step: Rotate | Oscillate, bench: Bench) -> None:
    """Start the rotation of the table."""
    table = bench.rig.table(step.role)
    bench.angles_deg.pop(step.role, None)
    if isinstance(step, Rotate):
        await table.rotate_at(step.rate_dps, acceleration_dps2=step.acceleration_dps2)
    else:
        await table.oscillate(step.amplitude_deg, step.frequencies_hz[0])


async def begin_sweep(step: Oscillate, bench: Bench) -> None:
    """Start the continuous sweep of an oscillation, if it has one. Raises StepError if the table has none."""
    if (chirp := step.chirp) is None or chirp.over_s is None:
        return
    table = bench.rig.table(step.role)
    if not isinstance(table, SweepingTable):
        raise StepError(f"{step.role} cannot sweep the frequency of an oscillation; use frequencies one after another")
    await table.sweep(chirp.to_hz, chirp.over_s)


async def _rotate(step: Rotate, bench: Bench) -> Found:
    await begin_turning(step, bench)
    await asyncio.sleep(step.least_s)
    rate = await bench.rig.table(step.role).rate()
    await bench.rig.table(step.role).stop()
    return {"rate_dps": rate.value}


async def _oscillate(step: Oscillate, bench: Bench) -> Found:
    """Oscillate the table at each frequency of a sweep; a positioning table returns to the centre before each."""
    table = bench.rig.table(step.role)
    bench.angles_deg.pop(step.role, None)
    centre = await table.angle()
    for number, frequency_hz in enumerate(step.frequencies_hz):
        if number and isinstance(table, Positioner):
            await table.move_to(centre.value, approach="direct", settle_s=0.0)
        await table.oscillate(step.amplitude_deg, frequency_hz)
        await asyncio.sleep(step.least_s / len(step.frequencies_hz))
    await table.stop()
    return {"frequencies_hz": list(step.frequencies_hz)}


def _credit_s(step: Soak, step_id: str, bench: Bench) -> float:
    """Return the seconds of the soak that count as passed."""
    if bench.credit is None:
        return 0.0
    given_s, text = bench.credit.given_s(step, step_id, bench.monitor, bench.journal)
    if text:
        bench.notice(text)
    return given_s


async def _set_output(step: SetOutput, bench: Bench) -> Found:
    """Switch an output, or those of all remaining units; the outputs of dropped units stay off."""
    units, found = bench.monitor.units, {}
    for role in bench.file.members(step.role) if step.output == "off" else units.members(step.role):
        try:
            found[role] = await _set_one(step, role, bench)
        except DriverError:
            if units.is_needed(role):  # The unit may have been dropped, and its output made safe, during the loop.
                raise
    return found.get(step.role, {"outputs": found})


async def _set_one(step: SetOutput, role: str, bench: Bench) -> Found:
    source = bench.rig.source(role)
    window = bench.monitor.windows.get(role)
    if window is not None:
        window.on_since_s = None
    level = step.voltage_v if step.voltage_v is not None else step.current_a
    if step.acceleration_g is not None and step.place is not None:
        nominal = bench.file.places[step.place].nominal
        level = step.acceleration_g * nominal.amperes_per_g if nominal is not None else math.nan
    limit = step.current_limit_a if step.current_limit_a is not None else step.compliance_v
    await source.set(level or 0.0, limit=limit or 0.0, output=step.output == "on")
    found = await source.read()
    if window is not None and step.output == "on" and bench.monitor.units.is_needed(role):
        window.on_since_s = asyncio.get_running_loop().time()
    return {"role": role, "voltage_v": found.voltage_v, "current_a": found.current_a, "output": found.output}


async def _ask(step: Prompt, step_id: str, bench: Bench) -> Found:
    question = Question(step_id, step.text, step.allowed, step.input, step.picture, step.expect)
    bench.journal.write("asked", step_id, text=step.text, expected=question.expected)
    answer = await bench.prompts.ask(question, step.give_up_after_s)
    found: dict[str, Any] = {"question": step.text, "by": answer.by, **_answer_facts(answer.value)}
    if step.name is not None:
        found["as"] = step.name
    if step.expect is not None and step.expect.mount is not None:
        found["mount"] = step.expect.mount
        bench.monitor.units.mount = bench.file.fixture.mount(step.expect.mount)
    if step.expect is not None and step.expect.input is not None:
        found["input"] = step.expect.input
        if step.expect.fed_channel:
            found["input_channel"] = step.expect.fed_channel
    return found


def _answer_facts(value: Quantity | str) -> dict[str, Any]:
    if isinstance(value, str) or not is_known(value):
        return {"value": str(value)}
    unit = customary_unit(value.dimension)
    return {"value": value.to(unit), "unit": unit}


async def _custom(step: Custom, bench: Bench) -> Found:
    description = known_steps()[step.name]
    settings = description.settings.model_validate(dict(step.settings))
    found: Found = await loaded(description.target)(settings, replace(bench, role=step.role))
    return found if step.value_name is None else {**found, "as": step.value_name}


async def orient(step: Orient, bench: Bench) -> Mapping[str, Any]:
    """Move one axis after the other, the outer first; an axis already at its target is not moved."""
    pose = Pose({role: await _angle_deg(role, bench) for role in bench.file.axes}, bench.journal.state.mount)
    try:
        targets = Turning(bench.file).targets_deg(step.attitude, pose)
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
