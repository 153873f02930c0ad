"""Mistakes that a reduction could make, planted on purpose to see that the comparison with the truth catches them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from unittest import mock

import numpy as np

from bench.methods.tumble.reduction.dwells import Dwell
from bench.metrology import pulse_counts as counting
from bench.metrology.acquisition import Acquisition
from bench.metrology.run_data import RunData
from bench.reduce import acquisitions as rundata
from bench.reduce.stored_run import open_run
from campaigns.truth.campaign import Comparison, compare_one
from drivers.dialects.can_counter import wire

ENDLESS_BITS = 62
Plant = Callable[[], AbstractContextManager[object]]


def comparisons_with(plant: Plant, folders: Sequence[Path]) -> list[Comparison]:
    """The runs reduced anew while an error is planted, beside their truths."""
    found = []
    for folder in folders:
        with plant(), open_run(folder) as stored:
            found += compare_one(folder, stored.evaluate().to_json())
    return found


def mean_of_four_bias() -> AbstractContextManager[object]:
    """The bias as the mean of all readings, which holds half of K2."""
    honest = Dwell.values.fget

    def mistaken(dwell: Dwell) -> dict[str, float]:
        return {**honest(dwell), "K0": float(np.mean(dwell.readings)) / dwell.tumble.k1}

    return mock.patch.object(Dwell, "values", property(mistaken))


@contextmanager
def host_time() -> Iterator[None]:
    """Rates over the arrival times at the host instead of the device's own clock."""
    decode = wire.decode_counts

    def mistaken(form: wire.CounterFormat, channel: str, *given: object) -> wire.Counts:
        honest = decode(form, channel, *given)
        ticks = np.rint(honest.host_s / form.tick_period_s).astype(np.int64)
        return honest._replace(tick=ticks, tick_bits=ENDLESS_BITS)

    with mock.patch.object(wire, "decode_counts", mistaken):
        yield


def _without_wrap(width: str) -> Plant:
    """One kind of counter taken as if it never went round, and what comes of it as good."""

    @contextmanager
    def plant() -> Iterator[None]:
        decode, rate = wire.decode_counts, counting._rate

        def mistaken(form: wire.CounterFormat, channel: str, *given: object) -> wire.Counts:
            return decode(form, channel, *given)._replace(**{width: ENDLESS_BITS})

        def unsuspecting(*given: object) -> counting.Rate:
            return rate(*given)._replace(problems=())

        with mock.patch.object(wire, "decode_counts", mistaken), mock.patch.object(counting, "_rate", unsuspecting):
            yield

    return plant


@contextmanager
def chamber_temperature() -> Iterator[None]:
    """The chamber's own sensor instead of the thermometer at the unit."""
    read = rundata.RunReader.series

    def mistaken(reader: rundata.RunReader, name: str, *_within: object) -> object:
        return read(reader, "chamber.process_value")

    with mock.patch.object(rundata.RunReader, "series", mistaken):
        yield


@contextmanager
def standard_gravity() -> Iterator[None]:
    """g_n instead of local g."""
    record = rundata.bench_record
    with mock.patch.object(
        rundata, "bench_record", lambda bench: dataclasses.replace(record(bench), gravity_mps2=9.80665)
    ):
        yield


@contextmanager
def swapped_lines() -> Iterator[None]:
    """The + and - lines of the converter the wrong way round."""
    decode = wire.decode_counts

    def mistaken(form: wire.CounterFormat, channel: str, *given: object) -> wire.Counts:
        honest = decode(form, channel, *given)
        return honest._replace(positive=honest.negative, negative=honest.positive)

    with mock.patch.object(wire, "decode_counts", mistaken):
        yield


def reversed_misalignment() -> AbstractContextManager[object]:
    """The misalignment with the opposite sign."""
    honest = Dwell.values.fget

    def mistaken(dwell: Dwell) -> dict[str, float]:
        return {**honest(dwell), "misalignment": -honest(dwell)["misalignment"]}

    return mock.patch.object(Dwell, "values", property(mistaken))


@contextmanager
def swapped_legs() -> Iterator[None]:
    """The dwells of rising temperature in place of those of falling temperature, in each cycle."""
    honest = RunData.groups

    def mistaken(data: RunData) -> dict[str, list[Acquisition]]:
        groups = honest(data)
        return {
            name: [dataclasses.replace(member, group=name) for member in members]
            for name, members in zip(groups, reversed(groups.values()), strict=True)
        }

    with mock.patch.object(RunData, "groups", mistaken):
        yield


PLANTED: dict[str, Plant] = {
    "mean-of-four bias": mean_of_four_bias,
    "host instead of device time": host_time,
    "missed counter wrap": _without_wrap("counter_bits"),
    "missed time-stamp wrap": _without_wrap("tick_bits"),
    "chamber instead of unit temperature": chamber_temperature,
    "g_n instead of local g": standard_gravity,
    "swapped + and - lines": swapped_lines,
    "reversed misalignment sign": reversed_misalignment,
    "swapped legs": swapped_legs,
}
