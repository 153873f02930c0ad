"""The start of a continuous sweep on tables that can sweep, and on one that cannot."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import pytest

from bench.engine.actions import begin_sweep
from bench.errors import StepError
from bench.sequence.steps.nested import UNROLLED
from bench.sequence.steps.stimulus import Oscillate


class Table:
    """A table that can rotate and oscillate."""

    async def rotate_at(self, rate_dps, *, acceleration_dps2): ...
    async def oscillate(self, amplitude_deg, frequency_hz): ...
    async def stop(self): ...
    async def rate(self): ...
    async def angle(self): ...


for name in ("identify", "poll", "make_safe", "__aenter__", "__aexit__"):
    setattr(Table, name, Table.stop)
Table.name = "table"


class Sweeping(Table):
    def __init__(self):
        self.sent = []

    async def sweep(self, to_hz, over_s):
        self.sent.append((to_hz, over_s))


def oscillation(**end):
    return Oscillate.model_validate({"oscillate": "table", "amplitude": "1°", "during": UNROLLED, **end})


def begin(step, table):
    asyncio.run(begin_sweep(step, SimpleNamespace(rig=SimpleNamespace(table=lambda _role: table))))


def test_a_sweep_goes_to_its_last_frequency_within_its_time():
    table = Sweeping()
    step = oscillation(sweep={"from": "2 Hz", "to": "20 Hz", "over": "3 min"})
    assert step.frequencies_hz == (2.0,)  # at which the oscillation begins
    begin(step, table)
    begin(oscillation(frequency="5 Hz"), table)  # which has no sweep
    assert table.sent == [(20.0, 180.0)]


def test_a_table_that_cannot_sweep_is_refused_in_words():
    with pytest.raises(StepError, match="table cannot sweep the frequency of an oscillation"):
        begin(oscillation(sweep={"from": "2 Hz", "to": "20 Hz", "over": "3 min"}), Table())
