"""Checks of the temperature circuits of inertial units in a bench file."""

from __future__ import annotations

from collections.abc import Iterator

from bench.config.document import Problem
from bench.config.models import BenchFile
from bench.config.places import PlaceEntry
from drivers.quantity.units import parse_unit
from drivers.schema.suggest import did_you_mean


def circuit_misfits(bench: BenchFile, name: str, place: PlaceEntry) -> Iterator[Problem]:
    """Yield problems of the temperature circuit of a unit: no such reading, or nominal values in another unit."""
    circuit, where = place.circuit, ("places", name, "circuit")
    if circuit is None:
        return
    if circuit.output not in bench.readings:
        problem = f"there is no reading '{circuit.output}'{did_you_mean(circuit.output, bench.readings)}"
        yield (*where, "output"), problem
        return
    if circuit.output == (circuit.reference or place.temperature):
        yield (*where, "output"), f"'{circuit.output}' is the thermometer that it is compared with"
    unit = bench.circuit_unit(name)
    if circuit.nominal is None and unit not in (None, "°C"):
        problem = f"'{circuit.output}' is in {unit}: its temperature needs nominal, at and slope"
        yield where, problem
    for key, given, wanted in (("nominal", circuit.nominal, unit), ("slope", circuit.slope, f"{unit}/°C")):
        if given is not None and unit is not None and given.dimension != parse_unit(wanted or "").dimension:
            yield (*where, key), f"is {given}, expected a quantity in {wanted}, as '{circuit.output}' is in {unit}"
