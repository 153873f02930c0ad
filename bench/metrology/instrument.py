"""Contribution to a result from the certificate of the instrument that measures an output."""

from __future__ import annotations

import numpy as np

from bench.metrology.bench_uncertainty import BenchRecord
from bench.metrology.results.budget import BudgetLine
from bench.metrology.run_data import UnitUnderTest

STEPS = ": steps of the codes"  # suffix of a source of uncertainty, after the channel of the telemetry


def instrument_lines(unit: UnitUnderTest, bench: BenchRecord, scaled: float, together: float) -> list[BudgetLine]:
    """Lines of a budget, with the signs of `scaled` and `together`.

    `scaled` is the sensitivity of the result to a relative error of all readings, `together` to a common offset. A unit
    that sends its output is its own instrument.
    """
    if unit.telemetry is not None:
        return []
    if unit.voltmeter is None:
        return [shared_line("counter: time base", scaled * bench.time_base_u)]
    gain_u, offset_u_v = bench.voltmeters_u.get(unit.voltmeter, (0.0, 0.0))
    return [
        shared_line(f"{unit.voltmeter}: gain", scaled * gain_u),
        shared_line(f"{unit.voltmeter}: offset", together * offset_u_v),
    ]


def shared_line(source: str, u: float | np.floating) -> BudgetLine:
    """A line of an error that all results have."""
    return BudgetLine(source, "B", float(u), None, shared_as(source))


def shared_as(source: str) -> str:
    """Identifier by which results recognise one common source."""
    return source.replace(": ", ".").replace(" ", "_")
