"""Mistakes planted in the reduction of a channel over temperature, which the comparison with the truth must see."""

from __future__ import annotations

from contextlib import AbstractContextManager
from unittest import mock

import numpy as np

from bench.methods.channel.reduction import levels as channel_runs
from bench.methods.channel.reduction import line as channel_temperature
from bench.metrology import gate_scatter as channel_scatter
from bench.metrology.pulse_counts import RESOLUTION_COUNTS


def opposite_lines() -> AbstractContextManager[object]:
    """The + and - lines of the converter the wrong way round."""
    honest = channel_runs.read_out

    def mistaken(acquisition: object, unit: object, gate_s: float) -> channel_temperature.ChannelRecord:
        record = honest(acquisition, unit, gate_s)
        return channel_temperature.ChannelRecord(
            record.time_s, record.negative, record.positive, record.converter_c, record.accelerometer_c
        )

    return mock.patch.object(channel_runs, "read_out", mistaken)


def host_clock() -> AbstractContextManager[object]:
    """Rates over the arrival times at the host instead of the device's own clock."""
    return mock.patch.object(channel_runs, "_device_s", lambda counts: counts.host_s)


def accelerometer_thermometer() -> AbstractContextManager[object]:
    """The thermometer of the chamber's other end: the accelerometer instead of the converter."""
    honest = channel_runs.means_between
    shift_c = 0.5
    return mock.patch.object(
        channel_runs, "means_between", lambda at_s, values, edges_s: honest(at_s, values, edges_s) * 1.01 + shift_c
    )


def late_temperatures() -> AbstractContextManager[object]:
    """Temperatures of a minute later than the counts they are put beside."""
    honest = channel_runs.means_between
    return mock.patch.object(
        channel_runs, "means_between", lambda at_s, values, edges_s: honest(at_s - 60.0, values, edges_s)
    )


def independent_gates() -> AbstractContextManager[object]:
    """Gates side by side averaged as if each had counts of its own, though they share their latches."""

    def mistaken(gains: np.ndarray, gates: channel_temperature.Gates) -> np.ndarray:
        return RESOLUTION_COUNTS * gains / gates.seconds

    return mock.patch.object(channel_scatter, "_of_latches", mistaken)


PLANTED = {
    "another thermometer": accelerometer_thermometer,
    "temperatures of a minute later": late_temperatures,
}
OF_COUNTING = {
    "gates averaged as independent": independent_gates,
    "swapped + and - lines": opposite_lines,
    "host instead of device time": host_clock,
}
