"""The checks that plug-ins run on their drivers: ours keep them, and drivers with a planted mistake do not."""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import replace

import pytest

from bench.app.contract import CHECKS, check
from drivers.description import known_drivers
from drivers.dialects.scpi_supply.driver import ScpiSupply
from drivers.errors import BadAnswer, DriverError
from drivers.values import Reading

SUPPLY = {
    "driver": "scpi_supply", "connection": "tcp://127.0.0.1:5025",
    "limits": {"voltage": {"max": "16 V"}, "current": {"max": "200 mA"}},
}  # fmt: skip
CHAMBER = {
    "driver": "espec_p300", "connection": "serial:///dev/ttyUSB0?baud=9600",
    "limits": {"temperature": {"min": "-40 °C", "max": "80 °C"}, "ramp_rate": {"max": "3 °C/min"}},
}  # fmt: skip
SOURCE = {
    "driver": "yokogawa_gs200", "connection": "tcp://127.0.0.1:7655",
    "options": {"range": "10 mA", "compliance": "10 V"}, "limits": {"current": {"min": "-10 mA", "max": "10 mA"}},
}  # fmt: skip


@pytest.mark.parametrize("entry", [SUPPLY, CHAMBER, SOURCE], ids=lambda entry: entry["driver"])
@pytest.mark.parametrize("name", CHECKS)
def test_our_drivers_keep_the_contract(name, entry):
    check(name, entry)


class Leaks(ScpiSupply):
    async def poll(self):
        try:
            return await super().poll()
        except BadAnswer as problem:
            raise ValueError(str(problem)) from None


class Waits(ScpiSupply):
    async def poll(self):
        while True:
            try:
                return await super().poll()
            except DriverError:
                await asyncio.sleep(1.0)


class MakesUp(ScpiSupply):
    async def poll(self):
        try:
            return await super().poll()
        except DriverError:
            return {"voltage": [Reading(0.0, 15.0)]}


class ReadsMore(ScpiSupply):
    async def poll(self):
        return {**await super().poll(), "power": [Reading(0.0, 1.0)]}


class Swears(ScpiSupply):
    async def make_safe(self):
        with contextlib.suppress(DriverError):
            await super().make_safe()


class TakesAnyone(ScpiSupply):
    def __init__(self, setup):
        super().__init__(replace(setup, identity=type(setup.identity)()))


class Lingers(ScpiSupply):
    async def __aexit__(self, *exc):
        self.lingering = asyncio.create_task(self._linger())

    async def _linger(self):
        while True:
            await asyncio.sleep(5.0)
            await super().poll()


@pytest.mark.parametrize(
    ("driver", "name", "reported"),
    [
        (Leaks, "survives_line_faults", "ValueError reaches the caller, expected a DriverError"),
        (Waits, "reports_silence", "no result within 60 s"),
        (MakesUp, "reports_silence", "silent: poll\\(\\) returns readings from a silent instrument"),
        (ReadsMore, "reads_described_channels", "poll\\(\\) returns \\['power'\\], not among the channels"),
        (Swears, "is_made_safe", "silent: make_safe\\(\\) reports success"),
        (TakesAnyone, "refuses_other_serial", "another serial number is accepted"),
        pytest.param(
            Lingers,
            "closes_quietly",
            "bytes are still sent after the driver was closed",
            marks=pytest.mark.leaves("the task of the mistake"),
        ),
    ],
)
def test_a_planted_mistake_is_found(driver, name, reported):
    description = known_drivers()["scpi_supply"]._replace(target=f"{__name__}:{driver.__name__}")
    with pytest.raises(AssertionError, match=reported):
        check(name, SUPPLY, description)
