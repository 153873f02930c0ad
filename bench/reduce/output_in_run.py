"""Output of a unit in one acquisition of a run, for its conversion by a calibration."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import reduce

import numpy as np

from bench.errors import InputError
from bench.metrology.acquisition import Acquisition, Array, Codes, Counts, Integers, Voltages
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.motion_records import CountRecord, Record, SampleRecord
from bench.metrology.outputs import Measured
from bench.metrology.pulse_counts import steps_of
from bench.metrology.run_data import UnitUnderTest
from bench.metrology.sampled_codes import sampled_at_s
from bench.metrology.temperature_checks import usable
from bench.offline.motion_series import Series, marked
from bench.reduce.acquisitions import run_data
from bench.reduce.stored_run import StoredRun
from drivers.schema.suggest import did_you_mean

MOST_NAMED = 5  # steps in a message


def output_in_run(stored: StoredRun, uut: str, channels: Mapping[str, Compensation], step: str | None) -> Series:
    """Output of the unit `uut` in an acquisition, with its own temperature.

    Counts are by the clock of the counter, samples by that of the run. The temperature is that of the converter if it
    has a thermometer, of an inertial unit else that of each sensor. Raises InputError without such a step or unit, or
    for an output in another unit.
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
            sizes = {name: known.force.step for name, known in channels.items() if known.force is not None}
            return marked(_record(found, unit, channels), steps=sizes)
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


def _record(acquisition: Acquisition, unit: UnitUnderTest, channels: Mapping[str, Compensation]) -> Record:
    """Output of all channels. Raises InputError if it is not usable."""
    found = {name: _measured(acquisition, unit, name, known.output_unit) for name, known in channels.items()}
    counts = {name: each for name, each in found.items() if isinstance(each, Counts)}
    codes = {name: each for name, each in found.items() if isinstance(each, Codes)}
    if any(each.restarts for each in counts.values()) or any(each.restarts for each in codes.values()):
        raise InputError(f"{acquisition.step}: what sends the output restarted, so that it is not one record")
    if counts:
        return _counted(acquisition, unit, counts)
    if codes:
        return _sent(acquisition, unit, codes)
    ((name, read),) = ((name, each) for name, each in found.items() if isinstance(each, Voltages))
    _expect_two(acquisition, len(read.at_s), channels)
    at_c, _ = _temperatures_c(acquisition, unit, channels, read.at_s)
    return SampleRecord(read.at_s - read.at_s[0], at_c, {name: read.values_v}, averaged=False)


def _measured(acquisition: Acquisition, unit: UnitUnderTest, name: str, wanted: str) -> Measured:
    """Raw output of a channel of a calibration. Raises InputError if its unit is not that of the calibration."""
    channel = unit.channels.get(name, name if name in unit.channels.values() else unit.measured_by)
    sensor = next((sensor for sensor, each in unit.channels.items() if each == channel), "")
    has = unit.unit_of(sensor) if sensor else unit.output_unit
    every: dict[str, Measured] = {**acquisition.counts, **acquisition.codes, **acquisition.voltages}
    if has != wanted or channel not in every:
        there = f"is in {has}" if has != wanted else "was not recorded"
        raise InputError(
            f"{acquisition.step}: the output of the unit {there}, and the calibration of channel {name} is of an "
            f"output in {wanted}; give the calibration of a run on such a bench"
        )
    return every[channel]


def _common(acquisition: Acquisition, channels: Mapping[str, Counts | Codes]) -> Integers:
    """Numbers of the latches or samples that all channels have. Raises InputError with fewer than two."""
    numbers = reduce(np.intersect1d, [each.sequence for each in channels.values()])
    _expect_two(acquisition, len(numbers), channels)
    return np.asarray(numbers, np.int64)


def _expect_two(acquisition: Acquisition, number: int, channels: Mapping[str, object]) -> None:
    if number < 2:
        raise InputError(f"{acquisition.step}: has fewer than two readings of all channels: {', '.join(channels)}")


def _counted(acquisition: Acquisition, unit: UnitUnderTest, channels: Mapping[str, Counts]) -> CountRecord:
    """Counts at the latches that all channels have."""
    common, first = _common(acquisition, channels), next(iter(channels.values()))
    rows = np.searchsorted(first.sequence, common)
    seconds = np.asarray(steps_of(first.tick[rows], first.tick_bits) * first.tick_period_s, np.float64)
    pulses = {name: _net_pulses(each, common, seconds) for name, each in channels.items()}
    time_s = np.concatenate(([0.0], np.cumsum(seconds)))
    at_c, own_c = _temperatures_c(acquisition, unit, channels, first.host_s[rows])
    return CountRecord(time_s, at_c, pulses, own_c)


def _sent(acquisition: Acquisition, unit: UnitUnderTest, channels: Mapping[str, Codes]) -> SampleRecord:
    """Samples with the numbers that all channels have."""
    common, first = _common(acquisition, channels), next(iter(channels.values()))
    at_s = sampled_at_s(first)[np.searchsorted(first.sequence, common)]
    samples = {name: each.values[np.searchsorted(each.sequence, common)] for name, each in channels.items()}
    at_c, own_c = _temperatures_c(acquisition, unit, channels, at_s)
    return SampleRecord(at_s - at_s[0], at_c, samples, averaged=first.averaged, own_c=own_c)


def _net_pulses(counts: Counts, common: Integers, seconds: Array) -> Array:
    """Net pulses (n - 1,) between latches, NaN where a counter may have wrapped unnoticed."""
    rows = np.searchsorted(counts.sequence, common)
    positive, negative = (steps_of(each[rows], counts.counter_bits) for each in (counts.positive, counts.negative))
    unknown = seconds * counts.max_rate_pps >= 1 << counts.counter_bits
    return np.where(unknown, np.nan, (positive - negative).astype(np.float64))


def _temperatures_c(
    acquisition: Acquisition, unit: UnitUnderTest, channels: Iterable[str], at_s: Array
) -> tuple[Array, Mapping[str, Array]]:
    """Temperature of the unit at times of the host, and of an inertial unit without a converter of each sensor."""
    if unit.converter or not unit.channels:
        return _temperature_c(acquisition, unit.converter or unit.temperature, at_s), {}
    readings = {name: unit.thermometer(name) for name in channels}
    read_c = {each: _temperature_c(acquisition, each, at_s) for each in dict.fromkeys(readings.values())}
    own_c = {name: read_c[reading] for name, reading in readings.items()}
    return next(iter(own_c.values())), own_c


def _temperature_c(acquisition: Acquisition, name: str, at_s: Array) -> Array:
    """Temperature by a reading at times of the host, linear between its values."""
    read_c, read_s = acquisition.temperatures_c.get(name), acquisition.temperatures_at_s.get(name)
    if read_c is None or read_s is None or not (known := usable(read_c)).any():
        raise InputError(f"{acquisition.step}: there is no reading of {name}, on which the calibration depends")
    return np.interp(at_s, read_s[known], read_c[known])
