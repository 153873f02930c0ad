"""The faults in FAULT_EFFECTS of each simulator, as its driver sees them, and their end."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import pytest

from bench.app.laboratory import simulator_of
from drivers.errors import DriverError
from drivers.kinds.chamber.driver import Chamber
from simulators.faults.instrument_faults import FaultKind, begin, end, fault_effects_of
from simulators.instruments.chambers.chamber import CHAMBER_FAULT_EFFECTS
from tests.contract.test_chambers import ALL
from tests.support import head as heads
from tests.support import source as sources
from tests.support import supply as supplies
from tests.support import table as tables
from tests.support.chambers import Dialect, Rig, with_rig

CHAMBERS = {dialect.driver: dialect for dialect in reversed(ALL)}  # one of each make
ROOM_C = 22.0


def of_chambers() -> Iterator[tuple[str, FaultKind]]:
    """What can happen to one make of chamber and not to all."""
    for driver, dialect in CHAMBERS.items():
        simulator = simulator_of(dialect.description)
        assert simulator is not None
        own = {
            kind
            for kind, mishap in fault_effects_of(simulator).items()
            if mishap is not CHAMBER_FAULT_EFFECTS.get(kind)
        }
        yield from ((driver, kind) for kind in sorted(own))


@pytest.mark.parametrize(("driver", "kind"), list(of_chambers()))
def test_a_chamber_that_is_no_more_as_it_was_commanded_is_a_fault(driver: str, kind: FaultKind) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as chamber:
            await chamber.ramp_to(21.0, 3.0)
            await chamber.poll()
            begin(rig.instrument, kind)
            seen = chamber.ramp_to(22.0, 3.0) if kind == "front_panel" else chamber.poll()  # protected when it is set
            with pytest.raises(DriverError, match="chamber: "):
                await seen
            end(rig.instrument, kind)

    with_rig(CHAMBERS[driver], use)


FOUND_WITHIN_S = {  # after it has happened in a soak at 60 °C, cooling_dead at -20 °C: until the air has left the band,
    "heater_dead": 300 + 600,  # and then the time for the gain
    "cooling_dead": 300 + 600,
    "slow": 300 + 600,  # of the next ramp
    "runaway": 240,
    "detached_sensor": 600,
    "open_sensor": 20,
}
EVERY_S = 10.0


async def looked_at(chamber: Chamber) -> None:
    """Looks until something is wrong."""
    while True:
        await asyncio.sleep(EVERY_S)
        await chamber.poll()


@pytest.mark.parametrize(
    ("dialect", "kind"),
    [(CHAMBERS["watlow_f4t"], kind) for kind in FOUND_WITHIN_S]
    + [(dialect, kind) for dialect in CHAMBERS.values() for kind in ("heater_dead", "open_sensor")],
    ids=str,
)
def test_a_chamber_that_breaks_is_a_fault_in_time_and_takes_its_safe_set_point(
    dialect: Dialect, kind: FaultKind
) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as chamber:
            await chamber.ramp_to(-20.0 if kind == "cooling_dead" else 60.0, 3.0)
            await asyncio.sleep(1800.0)
            begin(rig.instrument, kind)
            broken_s = rig.now_s()
            ramp = asyncio.create_task(chamber.ramp_to(90.0, 3.0)) if kind == "slow" else None
            with pytest.raises(DriverError, match=r"chamber: the (air|process value)|chamber: .*sensor"):
                await looked_at(chamber)
            assert rig.now_s() - broken_s <= FOUND_WITHIN_S[kind] + 2 * EVERY_S
            if ramp is not None:
                await ramp
            if not (kind == "open_sensor" and dialect.driver == "watlow_f4"):  # which says nothing without a sensor
                await chamber.make_safe()

    with_rig(dialect, use)


@pytest.mark.parametrize("dialect", list(CHAMBERS.values()), ids=lambda dialect: dialect.driver)
def test_an_open_door_draws_the_air_halfway_to_the_room_until_it_is_closed(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as chamber:
            await chamber.ramp_to(40.0, 3.0)
            await asyncio.sleep(3600.0)
            begin(rig.instrument, "door_open")
            await asyncio.sleep(3600.0)
            assert rig.air_c() == pytest.approx((40.0 + ROOM_C) / 2, abs=1.0)
            if dialect.driver == "simserv":
                with pytest.raises(DriverError, match="Door open"):
                    await chamber.poll()
            else:
                await chamber.poll()
            end(rig.instrument, "door_open")
            await asyncio.sleep(3600.0)
            assert rig.air_c() == pytest.approx(40.0, abs=0.7)

    with_rig(dialect, use)


@pytest.mark.parametrize("dialect", [heads.ENSEMBLE, heads.XPS], ids=["ensemble", "xps"])
@pytest.mark.parametrize("kind", ["emergency_stop", "tripped"])
def test_a_head_that_is_stopped_stands_and_says_so(dialect, kind: FaultKind) -> None:
    async def use(head, driver) -> None:
        move = asyncio.create_task(driver.move_to(90.0, approach="direct", settle_s=1.0))
        await asyncio.sleep(2.0)
        begin(head.controller, kind)
        with pytest.raises(DriverError, match="head: "):
            await move
        assert not head.moving
        assert 5.0 < head.angle_deg < 85.0

    heads.with_driver(use, dialect)


@pytest.mark.parametrize("kind", ["emergency_stop", "interlock"])
def test_a_table_whose_interlock_has_opened_says_so(kind: FaultKind) -> None:
    async def use(table, driver) -> None:
        begin(table.controller, kind)
        with pytest.raises(DriverError, match="table: "):
            await driver.move_to(10.0, approach="direct", settle_s=1.0)

    tables.with_driver(use)


@pytest.mark.parametrize(
    ("with_source", "kind"),
    [
        (sources.with_driver, "interlock"), (sources.with_driver, "compliance"), (sources.with_driver, "restart"),
        (sources.with_gs200, "compliance"), (sources.with_gs200, "restart"), (sources.with_gs200, "tripped"),
    ],
)  # fmt: skip
def test_a_source_whose_current_is_not_what_was_set_is_a_fault(with_source, kind: FaultKind) -> None:
    async def use(rig, driver) -> None:
        await driver.set(5e-3, limit=10.0, output=True)
        begin(rig.instrument, kind)
        with pytest.raises(DriverError, match="source: "):
            await driver.poll()
        if kind == "compliance":
            end(rig.instrument, kind)
            assert rig.instrument.current_a == pytest.approx(5e-3)

    with_source(use)


@pytest.mark.parametrize("kind", ["tripped", "restart"])
def test_a_supply_that_goes_off_by_itself_is_a_fault(kind: FaultKind) -> None:
    async def use(supply, driver) -> None:
        await driver.set(15.0, limit=0.2, output=True)
        begin(supply.instrument, kind)
        with pytest.raises(DriverError, match="supply: "):
            await driver.poll()

    supplies.with_driver(use)
