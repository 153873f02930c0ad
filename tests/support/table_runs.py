"""Acquisitions on a rate table, made of a known charge and a known angle at the latches; what is known of a bench."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bench.metrology.acquisition import Acquisition, Codes, Counts, Motion, Positions, Voltages
from bench.metrology.bench_uncertainty import AxisRecord, BenchRecord, ClockRecord
from bench.metrology.run_data import RunData, UnitUnderTest
from simulators.physics.integrator import Integrator

UNIT = UnitUnderTest("a", "SN", "x", 0.0, "warm")
COUNT_DEG = 1e-4
TICKS = 1000


def acquired(charge, angle_deg, *, motion=None, lost=(), bits=24, first=0, residue=0.3, ticks=TICKS):
    """Output of a counter and an encoder for a charge in pulses and an angle, both at the latches (n,)."""
    latch = np.arange(len(charge))
    positive, negative = Integrator(residue, first, 0).count_through_turns(np.diff(charge, prepend=charge[0]))
    position = np.floor(angle_deg / COUNT_DEG).astype(np.int64)
    kept = np.array([number not in lost for number in latch])
    counts = Counts(
        sequence=latch[kept] + 65_000, tick=(latch[kept] * ticks + 4_294_900_000) % 2**32,
        positive=positive[kept] % 2**bits, negative=negative[kept], host_s=latch[kept] * ticks * 1e-6, tick_bits=32,
        counter_bits=bits, tick_period_s=1e-6, max_rate_pps=2e6, lost=len(lost), restarts=0,
    )  # fmt: skip
    encoder = Positions(latch + 65_000, counts.tick, position % 2**32, 32, 32, 1e-6, COUNT_DEG)
    return _acquisition((len(charge) - 1) * ticks * 1e-6, motion, {"table": encoder}, counts={"x": counts})


SENT = replace(UNIT, channel="", telemetry="x")
READ = replace(UNIT, channel="", voltmeter="dvm")


def sent(values, angle_deg, *, motion=None, lost=(), averaged=True, beside=False, step=1.0):
    """Sample (n,) that a unit sends, rounded to steps, and an encoder latched at their ends: or on another clock."""
    number = np.arange(len(values))
    kept = np.array([each not in lost for each in number])
    number = number[kept]
    position = np.floor(np.asarray(angle_deg)[kept] / COUNT_DEG).astype(np.int64)
    codes = Codes(
        sequence=number + 250, tick=(number * TICKS + 16_777_000) % 2**24, values=np.rint(values[kept] / step) * step,
        host_s=number * 1e-3, tick_bits=24, tick_period_s=1e-6, step=step, lost=len(lost), dropped=0, invalid=0,
        averaged=averaged,
    )  # fmt: skip
    numbers, channel = (number + 7000, "") if beside else (codes.sequence, "x")
    encoder = Positions(
        numbers, codes.tick, position % 2**32, 24, 32, 1e-6, COUNT_DEG, host_s=codes.host_s, channel=channel
    )
    return _acquisition((len(values) - 1) * 1e-3, motion, {"table": encoder}, codes={"x": codes})


def read(at_s, volts, angle_deg, *, motion=None):
    """Readings of a voltmeter, and an encoder with a clock of its own, latched at TIME_S."""
    number = np.arange(len(TIME_S))
    position = np.floor(angle_deg / COUNT_DEG).astype(np.int64)
    encoder = Positions(number, number * TICKS, position % 2**32, 32, 32, 1e-6, COUNT_DEG, host_s=TIME_S * (1 + 2e-5))
    return _acquisition((len(TIME_S) - 1) * 1e-3, motion, {"table": encoder}, voltages={"dvm": Voltages(at_s, volts)})


def _acquisition(end_s, motion, positions, **measured):
    return Acquisition(
        step="steps/x/acquire", group="", loops={}, begin_s=0.0, end_s=end_s, angles_deg={},
        set_from_c=np.nan, set_c=np.nan, temperatures_c={"warm": np.array([20.0, 21.0])},
        temperatures_at_s={}, positions=positions, motion=motion, **({"counts": {}} | measured),
    )  # fmt: skip


BENCH = BenchRecord(
    gravity_mps2=9.8, gravity_u_mps2=1e-4, axes={"table": AxisRecord(harmonics_u_deg=(1e-3,), wobble_u_deg=5e-4)},
    x=(1.0, 0.0, 0.0), z=(0.0, 0.0, 1.0), level_deg=0.0, level_u_deg=5e-4, time_base_u=1e-6, thermometers_u={},
    encoder_skew_u_s=5e-5, voltmeters_u={"dvm": (4e-6, 1e-6)}, telemetry=ClockRecord("telemetry", 5e-6, 2e-5),
)  # fmt: skip
TIME_S = np.arange(3001) / 1000


def data(*acquisitions: Acquisition, unit: UnitUnderTest = UNIT, bench: BenchRecord = BENCH) -> RunData:
    """All of a run, the acquisitions in their order and each a minute after the one before."""
    placed = tuple(
        replace(each, step=f"steps/n={n}/acquire", begin_s=60.0 * n, end_s=60.0 * n + each.end_s)
        for n, each in enumerate(acquisitions)
    )
    return RunData("range", (unit,), placed, bench)


def at_rest(bias_pps: float, angle_deg: float = 0.0) -> Acquisition:
    """Standing at an angle."""
    found = acquired(bias_pps * TIME_S, 0 * TIME_S + angle_deg)
    return replace(found, angles_deg={"table": angle_deg})


def at_rate(command_dps: float, output_pps: float, rate_dps: float | None = None) -> Acquisition:
    """Turning at a rate, that which was asked for unless another is given."""
    turned_deg = (command_dps if rate_dps is None else rate_dps) * TIME_S
    return acquired(output_pps * TIME_S, turned_deg, motion=Motion("table", command_dps))


def swinging(frequency_hz: float, charge, amplitude_dps: float = 10.0, told_hz: float | None = None) -> Acquisition:
    """Swinging, with a `charge` that is a function of the phase of the rate's cosine and of time."""
    phase = 2 * np.pi * frequency_hz * TIME_S + 0.4
    angle_deg = amplitude_dps / (2 * np.pi * frequency_hz) * np.sin(phase)
    motion = Motion("table", amplitude_deg=1.0, frequency_hz=told_hz or frequency_hz)
    return acquired(charge(phase, TIME_S), angle_deg, motion=motion)
