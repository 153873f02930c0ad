"""Frames through python-can: an adapter with a descriptor, one without, and what goes wrong."""

import asyncio
import time

import can
import numpy as np
import pytest

from drivers.can.bus_errors import BUS_OFF, class_names, error_classes
from drivers.can.frame_block import ERROR, EXTENDED
from drivers.errors import CannotConnect, LinkLost
from drivers.transport.address import Address
from drivers.transport.can import open_can
from tests.support.frames import taken

pytestmark = pytest.mark.integration

MULTICAST = pytest.param("udp_multicast/239.74.163.2", marks=pytest.mark.peer("msgpack"))
FRAMES = [
    can.Message(arbitration_id=0x100, data=bytes(range(8)), is_extended_id=False),
    can.Message(arbitration_id=0x18FF0100, data=b"\x2a", is_extended_id=True),
    can.Message(arbitration_id=0x7FF, data=b"", is_extended_id=False),
]


@pytest.fixture(params=["virtual/itb", MULTICAST])
def adapter(request: pytest.FixtureRequest) -> tuple[str, str]:
    """The interface and channel of an adapter that is read by a thread, and of one whose descriptor the loop reads."""
    interface, _, channel = request.param.partition("/")
    try:
        can.Bus(interface=interface, channel=channel).shutdown()
    except OSError as problem:
        pytest.skip(f"no {interface} on this machine ({problem})")
    return interface, channel


def test_frames_arrive_in_order_with_their_times(adapter: tuple[str, str]) -> None:
    interface, channel = adapter

    async def main() -> None:
        loop = asyncio.get_running_loop()
        link = await open_can("counter", Address.parse(f"can:{interface}/{channel}"))
        with can.Bus(interface=interface, channel=channel) as sender:
            began_s = loop.time()
            for frame in FRAMES:
                sender.send(frame)
            block = await taken(link, 3)
        assert block.ids.tolist() == [0x100, 0x18FF0100 | EXTENDED, 0x7FF]
        assert block.dlc.tolist() == [8, 1, 0]
        assert block.data.tolist() == [list(range(8)), [42, 0, 0, 0, 0, 0, 0, 0], [0] * 8]
        assert ((began_s <= block.at_s) & (block.at_s <= loop.time())).all()
        assert (np.diff(block.at_s) >= 0).all()
        assert len(link.take()) == 0
        link.close()
        link.close()

    asyncio.run(main())


def test_remote_frames_are_passed_over_and_error_frames_say_that_they_are() -> None:
    async def main() -> None:
        link = await open_can("counter", Address.parse("can:virtual/itb-remote"))
        with can.Bus(interface="virtual", channel="itb-remote") as sender:
            sender.send(can.Message(arbitration_id=0x100, is_remote_frame=True, is_extended_id=False))
            sender.send(can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False))
            sender.send(FRAMES[0])
            block = await taken(link, 2)
        assert block.ids.tolist() == [ERROR | BUS_OFF, 0x100]
        assert class_names(error_classes(block).tolist()) == "bus off"
        link.close()

    asyncio.run(main())


def test_closing_ends_the_reader_thread_at_once() -> None:
    async def main() -> None:
        link = await open_can("counter", Address.parse("can:virtual/itb-close"))
        began_s = time.monotonic()
        link.close()
        assert time.monotonic() - began_s < 1

    asyncio.run(main())


def test_an_adapter_that_fails_is_a_lost_link(adapter: tuple[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    """The bus class is that of python-can; only its reception breaks, as when an adapter is pulled out."""
    interface, channel = adapter

    async def main() -> None:
        link = await open_can("counter", Address.parse(f"can:{interface}/{channel}"))

        def pulled_out(self: can.BusABC, timeout: float | None = None) -> None:
            raise can.CanOperationError("device gone")

        monkeypatch.setattr(can.BusABC, "recv", pulled_out)
        with can.Bus(interface=interface, channel=channel) as sender:
            sender.send(FRAMES[0])
            with pytest.raises(LinkLost, match=r"counter: device gone.*Check the bus"):
                await taken(link, 2)
        link.close()

    asyncio.run(main())


@pytest.mark.parametrize("address", ["can:no_such_interface/can0", "can:socketcan/no_such_channel"])
def test_an_adapter_that_is_not_there_is_told_with_its_address(address: str) -> None:
    async def main() -> None:
        with pytest.raises(CannotConnect, match=rf"counter: cannot open {address}.*Check the adapter"):
            await open_can("counter", Address.parse(address))

    asyncio.run(main())
