"""Contribution to a result from the certificate of the instrument that measures an output."""

from __future__ import annotations

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
        return [bench.clock(sent=False).time_base.times(scaled)]
    gain, offset = bench.voltmeter(unit.voltmeter)
    return [gain.times(scaled), offset.times(together)]
