"""Interface to open connections to instruments, and its implementation for real ones."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Awaitable, Callable
from typing import Protocol, TypeVar

from drivers.errors import CannotConnect
from drivers.timing.awake import fair_timeout
from drivers.transport.address import Address
from drivers.transport.frame_link import FrameLink

P = TypeVar("P", bound=asyncio.Protocol)
SIMULATED_ONLY = "INERTIAL_TEST_BENCH_SIMULATED_ONLY"  # environment variable of a process without rights to a bench


class Wires(Protocol):
    """Opens connections for drivers; its implementation decides what they lead to."""

    async def stream(self, device: str, address: Address, factory: Callable[[], P]) -> P:
        """Connect `factory()` to a TCP connection or a serial line; raises CannotConnect."""

    async def frames(self, device: str, address: Address) -> FrameLink:
        """Open a CAN channel; raises CannotConnect."""


class RealWires:
    """Sockets, serial ports and CAN adapters of this machine."""

    async def stream(self, device: str, address: Address, factory: Callable[[], P]) -> P:
        """Connect `factory()` to the other end of `address`."""
        _expect_rights(device, address)
        if address.scheme == "serial":
            from drivers.transport.serial import open_serial

            return await open_serial(device, address, factory)
        loop = asyncio.get_running_loop()
        try:
            async with fair_timeout(10):
                _, protocol = await loop.create_connection(factory, address.host, address.port)
        except (OSError, TimeoutError) as problem:
            raise CannotConnect(
                device, f"no connection to {address} ({str(problem) or 'no answer within 10 s'})",
                remedy="Check that the instrument is on, its network address, and the port in the bench file.",
            ) from problem  # fmt: skip
        return protocol

    async def frames(self, device: str, address: Address) -> FrameLink:
        """Open the CAN adapter at `address`, a bus of its server, or its log."""
        _expect_rights(device, address)
        if address.scheme == "socketcand":
            from drivers.transport.socketcand import Socketcand, open_socketcand

            def join(factory: Callable[[], Socketcand]) -> Awaitable[Socketcand]:
                return self.stream(device, address, factory)

            return await open_socketcand(device, address, join)
        from drivers.transport.can import open_can

        return await open_can(device, address)


def _expect_rights(device: str, address: Address) -> None:
    """Raise CannotConnect for a real connection if this process may use simulated ones only."""
    if os.environ.get(SIMULATED_ONLY) and not address.simulated:
        raise CannotConnect(
            device, f"{address} is a real connection, and this process may use simulated ones only",
            remedy=f"A worker of a campaign has no rights to a bench; elsewhere, unset {SIMULATED_ONLY}.",
        )  # fmt: skip
