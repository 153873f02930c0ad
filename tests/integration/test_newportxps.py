"""The package newportxps, which other people wrote, uses the simulated XPS over TCP."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from bench.loop import run
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.axes.newport_xps import SimulatedXps
from simulators.serving.serve import protocol_factory
from simulators.units.settings import WorldSettings
from simulators.world import World

pytestmark = [pytest.mark.integration, pytest.mark.peer("newportxps")]


def with_newportxps(use: Callable[[Any, SimulatedXps], None]) -> None:
    """Runs `use` in a thread, with newportxps connected to a controller that this loop serves.

    It reads the names of groups and stages over FTP, which is no part of the protocol: they are given to it here.
    """

    def connect(port: int, controller: SimulatedXps) -> None:
        from newportxps import NewportXPS

        class Told(NewportXPS):  # type: ignore[misc]  # newportxps has no types
            def read_systemini(self) -> None:
                self.groups = {"HEAD": {"category": "singleaxisinuse", "positioners": ["Pos"]}}
                self.stages = {"HEAD.Pos": {"stagetype": "simulated"}}

        xps = Told("127.0.0.1", port=port)
        try:
            use(xps, controller)
        finally:
            xps.disconnect()

    async def main() -> None:
        loop = asyncio.get_running_loop()
        world = World(WorldSettings(seed=1, gravity_mps2=9.8), loop.time)
        controller = SimulatedXps(world, FaultPlan(now_s=loop.time), homed=False)
        server = await loop.create_server(protocol_factory(controller), "127.0.0.1", 0)
        async with server:
            await asyncio.to_thread(connect, server.sockets[0].getsockname()[1], controller)

    run(main())


def test_it_initialises_homes_moves_and_reads() -> None:
    def use(xps: Any, controller: SimulatedXps) -> None:
        assert xps.firmware_version == "XPS-C8 Firmware V2.6.1"
        assert xps._xps.errorcodes["-22"] == "Not allowed action"
        assert xps.get_group_status() == {"HEAD": "Not initialized state"}
        xps.initialize_group("HEAD", with_encoder=False)
        xps.home_group("HEAD")
        assert xps.get_group_status() == {"HEAD": "Ready state from homing"}
        xps.set_velocity("HEAD.Pos", 40, 160)
        assert controller.profile[:2] == (40.0, 160.0)
        xps.move_stage("HEAD.Pos", 12.5)
        assert xps.get_stage_position("HEAD.Pos") == 12.5
        assert xps.get_group_status() == {"HEAD": "Ready state from motion"}
        xps.move_stage("HEAD.Pos", -2.5, relative=True)
        assert xps.get_stage_position("HEAD.Pos") == 10.0
        driver, socket = xps._xps, xps._sid
        assert driver.GroupMoveAbsolute(socket, "HEAD", [11.5])[0] == 0
        assert driver.GroupPositionCurrentGet(socket, "HEAD", 1) == [0, 11.5]
        assert xps.get_positioner_errors() == {"HEAD.Pos": "OK"}

    with_newportxps(use)


def test_it_is_refused_as_by_a_controller() -> None:
    def use(xps: Any, controller: SimulatedXps) -> None:
        from newportxps.XPS_C8_drivers import XPSException

        with pytest.raises(XPSException, match=r"Not allowed action.*\[Error -22\]"):
            xps.move_stage("HEAD.Pos", 12.5)
        controller.trip()
        assert xps.get_positioner_errors() == {"HEAD.Pos": "Fatal following error"}
        assert xps.get_positioner_errors() == {"HEAD.Pos": "OK"}

    with_newportxps(use)
