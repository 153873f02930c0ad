"""Report of an inertial unit on a rate table: the plots and tables of each of its sensors, in the order of the run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from bench.figures.languages import tr
from bench.figures.plots import Plot
from bench.figures.sheet import Sheet
from bench.methods.rate_table.reduction.assembly import Assembly
from bench.metrology.results.finding import UnitResult

Draw = Callable[[UnitResult, str], Iterator[Plot | Sheet]]


def of_each_sensor(unit: UnitResult, name: str, draw: Draw) -> Iterator[Plot | Sheet]:
    """Plots and tables of a unit, or of each sensor of an inertial unit with its name and mounting in the titles."""
    if not isinstance(unit.detail, Assembly):
        yield from draw(unit, name)
        return
    for sensor, part in unit.detail.parts:
        at = (sensor.name, sensor.mount)
        findings = tuple(each for each in unit.findings if (each.at["sensor"], each.at["mount"]) == at)
        own = "-".join(filter(None, (name, sensor.mount, sensor.name)))
        for each in draw(replace(part, findings=findings), own):
            yield replace(each, title=f"{tr(', ').join(filter(None, at))} – {each.title}")
