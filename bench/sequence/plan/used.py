"""Devices of a bench that a run requires."""

from __future__ import annotations

from collections.abc import Iterator

from bench.config.models import BenchFile
from bench.sequence.plan.plan import Plan
from bench.sequence.steps.custom import Custom
from bench.sequence.steps.orienting import Orient
from drivers.capabilities import OUTPUT


def devices_used(plan: Plan, bench: BenchFile) -> frozenset[str]:
    """Devices that a plan acts on or reads, and those that supply, measure and monitor the units in their places.

    All devices, if a step of a plug-in may use any. `bench` has units in the places of the run.
    """
    steps = [planned.step for planned in plan]
    if any(isinstance(step, Custom) for step in steps):
        return frozenset(bench.devices)
    names = set(plan.sequence.needs)
    for entry in bench.places.values():
        names |= {*entry.dependencies, *bench.measuring(entry)} - {entry.source}
    for interlock in (*bench.interlocks.values(), *plan.sequence.interlocks.values()):
        names |= set(interlock.names)
    named = (vars(step).get(key) for step in steps for key in ("role", "of", "reading"))
    names |= {str(name) for name in named if name is not None}
    if any(isinstance(step, Orient) for step in steps):
        names |= set(bench.axes)
    outputs = {name for name, kind in plan.sequence.needs.items() if kind == OUTPUT}
    return frozenset(device for name in names for device in _devices(name, bench, is_output=name in outputs))


def _devices(name: str, bench: BenchFile, *, is_output: bool) -> Iterator[str]:
    """Devices behind a role, a named reading, DEVICE.CHANNEL, or a group name."""
    if is_output:
        yield from bench.acquired_from(name)
    for member in bench.members(name):
        source = bench.readings[member].from_ if member in bench.readings else member
        if (device := source.partition(".")[0]) in bench.devices:
            yield device
