"""CAN adapters of this machine as frame links."""

from __future__ import annotations

from drivers.errors import CannotConnect
from drivers.transport.address import Address
from drivers.transport.frames import FrameLink


async def open_can(device: str, address: Address) -> FrameLink:
    """Opens the adapter at `address`; raises CannotConnect."""
    raise CannotConnect(device, f"no adapter known for {address}")
