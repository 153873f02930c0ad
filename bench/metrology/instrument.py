"""Contribution to a result from the certificate of the instrument that measures an output."""

from __future__ import annotations

from collections.abc import Mapping

from bench.metrology.bench_uncertainty import BenchRecord
from bench.metrology.run_data import UnitUnderTest

STEPS = ": steps of the codes"  # suffix of a source of uncertainty, after the channel of the telemetry


def instrument_u(unit: UnitUnderTest, bench: BenchRecord, scaled: float, together: float) -> Mapping[str, float]:
    """Standard uncertainties by source, with the signs of `scaled` and `together`.

    `scaled` is the sensitivity of the result to a relative error of all readings, `together` to a common offset. A unit
    that sends its output is its own instrument.
    """
    if unit.telemetry is not None:
        return {}
    if unit.voltmeter is None:
        return {"counter: time base": scaled * bench.time_base_u}
    gain_u, offset_u_v = bench.voltmeters_u.get(unit.voltmeter, (0.0, 0.0))
    return {f"{unit.voltmeter}: gain": scaled * gain_u, f"{unit.voltmeter}: offset": together * offset_u_v}


def shared_as(source: str) -> str:
    """Identifier by which results recognise one common source."""
    return source.replace(": ", ".").replace(" ", "_")
