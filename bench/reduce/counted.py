"""Counts of a unit in one acquisition of a run, for their conversion by a calibration."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from bench.errors import InputError
from bench.metrology.acquisition import Acquisition, Array, Counts, Integers
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.pulse_counts import steps_of
from bench.metrology.run_data import UnitUnderTest
from bench.metrology.temperature_checks import beyond_possible
from bench.metrology.velocity import CountRecord
from bench.offline.count_series import CountSeries, marked
from bench.reduce.acquisitions import run_data
from bench.reduce.stored_run import StoredRun
from drivers.schema.suggest import did_you_mean

MOST_NAMED = 5  # steps in a message


def counted_in_run(stored: StoredRun, uut: str, channels: Sequence[str], step: str | None) -> CountSeries:
    """Counts of the unit `uut` in an acquisition, by the clock of the counter, with its own temperature.

    The temperature is that of the converter if it has a thermometer, of an inertial unit else that of each sensor.
    Raises InputError without such a step or unit.
    """
    labels = dict.fromkeys(label for entry in stored.sequence.results for label in entry.labels)
    for label in labels:
        data = run_data(stored.reader, stored.bench, stored.serials, label)
        found = next((each for each in data.acquisitions if each.step == step), None)
        if found is not None:
            unit = next((each for each in data.units if each.serial == uut), None)
            if unit is None:
                there = ", ".join(each.serial for each in data.units)
                raise InputError(f"{stored.folder.name}: has no unit {uut}, of which the calibration is, but {there}")
            return marked(_record(found, unit, channels))
    steps = [each.step for label in labels for each in stored.data(label).acquisitions]
    which = f"there is no acquisition '{step}'{did_you_mean(step, steps)}" if step else "give --step, one of a run"
    more = f" and {len(steps) - MOST_NAMED} more" if len(steps) > MOST_NAMED else ""
    raise InputError(f"{stored.folder.name}: {which}. It has {', '.join(steps[:MOST_NAMED])}{more}")


def other_thermometers(stored: StoredRun, uut: str, channels: Mapping[str, Compensation]) -> Iterator[str]:
    """Remarks on channels that a run reads by another thermometer than their calibration."""
    places = {serial: place for place, serial in stored.serials.items()}
    read_by = stored.bench.places[places[uut]].at_sensors if uut in places else {}
    for name, known in channels.items():
        if known.thermometer and read_by.get(name, known.thermometer) != known.thermometer:
            yield f"{name} is calibrated over {known.thermometer}; here its temperature is that of {read_by[name]}"


def _record(acquisition: Acquisition, unit: UnitUnderTest, channels: Sequence[str]) -> CountRecord:
    """Counts at the latches that all channels have. Raises InputError if they are not usable."""
    counts = [acquisition.counts[unit.channels.get(name, unit.channel)] for name in channels]
    if any(each.restarts for each in counts):
        raise InputError(f"{acquisition.step}: the counter restarted, so that its counts are not one record")
    common = counts[0].sequence
    for each in counts[1:]:
        common = np.intersect1d(common, each.sequence)
    if len(common) < 2:
        raise InputError(f"{acquisition.step}: has fewer than two latches with all channels: {', '.join(channels)}")
    first = counts[0]
    rows = np.searchsorted(first.sequence, common)
    seconds = np.asarray(steps_of(first.tick[rows], first.tick_bits) * first.tick_period_s, np.float64)
    pulses = {name: _net_pulses(each, common, seconds) for name, each in zip(channels, counts, strict=True)}
    time_s = np.concatenate(([0.0], np.cumsum(seconds)))
    host_s = first.host_s[rows]
    if unit.converter or not unit.channels:
        return CountRecord(time_s, _temperature_c(acquisition, unit.converter or unit.temperature, host_s), pulses)
    read_c = {
        reading: _temperature_c(acquisition, reading, host_s)
        for reading in dict.fromkeys(unit.thermometer(name) for name in channels)
    }
    own_c = {name: read_c[unit.thermometer(name)] for name in channels}
    return CountRecord(time_s, own_c[channels[0]], pulses, own_c)


def _net_pulses(counts: Counts, common: Integers, seconds: Array) -> Array:
    """Net pulses (n - 1,) between latches, NaN where a counter may have wrapped unnoticed."""
    rows = np.searchsorted(counts.sequence, common)
    positive, negative = (steps_of(each[rows], counts.counter_bits) for each in (counts.positive, counts.negative))
    unknown = seconds * counts.max_rate_pps >= 1 << counts.counter_bits
    return np.where(unknown, np.nan, (positive - negative).astype(np.float64))


def _temperature_c(acquisition: Acquisition, name: str, at_s: Array) -> Array:
    """Temperature by a reading at times of the host, linear between its values."""
    read_c, read_s = acquisition.temperatures_c.get(name), acquisition.temperatures_at_s.get(name)
    usable = np.zeros(0, np.bool_) if read_c is None else np.isfinite(read_c) & ~beyond_possible(read_c)
    if read_c is None or read_s is None or not usable.any():
        raise InputError(f"{acquisition.step}: there is no reading of {name}, on which the calibration depends")
    return np.interp(at_s, read_s[usable], read_c[usable])
