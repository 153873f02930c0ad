"""Checks of steps that use outputs of units, against the bench."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from bench.config.models import BenchFile
from bench.sequence.steps.fields import is_known
from bench.sequence.steps.waits import Steady
from drivers.quantity.units import QuantityError

Found = Iterator[tuple[str, str]]  # (key with the problem, problem)


def steady_problems(steady: Steady, places: Iterable[str], bench: BenchFile) -> Found:
    """Reasons why the outputs of units cannot be checked against a stability criterion."""
    for name in places:
        if bench.places[name].channels is not None:
            yield "wait_until", f"'steady' is for units with one channel; place '{name}' is for an inertial unit"
        elif is_known(steady.change) and not steady.in_g:
            try:
                steady.change.to(bench.output_unit(name))
            except QuantityError as problem:
                yield "steady", str(problem)
        elif is_known(steady.change):
            yield from without_nominal("steady", (name,), bench)


def without_nominal(key: str, places: Iterable[str], bench: BenchFile) -> Found:
    """Units without a nominal output at 1 g in the bench file, where a step needs one."""
    for name in places:
        if bench.nominal_per_g(name) is None:
            parts = bench.places[name].output_per_g_keys
            makes = "which makes it of g" if len(parts) == 1 else "which make it of g"
            yield key, f"places.{name} of the bench file has no nominal {' and '.join(parts)}, {makes}"
