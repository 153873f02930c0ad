"""What every driver that speaks on a line has to keep, as checks that the tests of a plug-in run on its own simulator.

    @pytest.mark.parametrize("name", CHECKS)
    def test_the_contract_of_every_driver(name):
        check(name, {"driver": "my_chamber", "connection": "tcp://127.0.0.1:5025", "limits": {...}})

A check runs the real driver on its simulator in virtual time, and raises AssertionError with what was not kept.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import TypeVar

from bench.config.devices import DeviceEntry
from bench.loop import AS_FAST_AS_POSSIBLE
from bench.loop import run as run_loop
from drivers.capabilities import Device
from drivers.description import DriverDescription, IdentityPin, Setup, make_driver
from drivers.errors import CannotConnect, DriverError, WrongIdentity
from drivers.transport.address import Address
from drivers.transport.frame_link import FrameLink
from drivers.transport.memory import Line, join
from simulators.faults.instrument_faults import LINE_FAULTS, FaultKind, FaultPlan, begin, end, mishaps_of
from simulators.faults.line_faults import BadLine
from simulators.instruments.can_nodes.can_node import CanNode, NodeSetup, make_node
from simulators.instruments.setup import InstrumentSetup, make_instrument
from simulators.serving.serve import Instrument, protocol_factory
from simulators.units.settings import WorldSettings
from simulators.world import World

P = TypeVar("P", bound=asyncio.Protocol)
NAME = "subject"
ANSWERS_WITHIN_S = 60.0
SAFE_SLACK_S = 0.1
HEALS_IN_POLLS, HEALS_AFTER_S = 3, 40.0  # lost wires are tried again after up to half a minute


class Subject:
    """A driver and its simulator on a line in memory; create it in the running loop.

    `description` overrides that of the entry.
    """

    def __init__(self, entry: DeviceEntry, description: DriverDescription | None = None) -> None:
        self.entry, self.description = entry, description or entry.description
        world = World(WorldSettings(seed=1, gravity_mps2=9.8), asyncio.get_running_loop().time)
        address = entry.connection
        faults = FaultPlan(now_s=world.now)
        self.instrument: Instrument | CanNode
        if self.description.frames is not None:
            self.instrument = make_node(self.description.simulator, NodeSetup(NAME, world, faults, entry.options))
        else:
            setup = InstrumentSetup(
                NAME, world, faults, entry.options, model=entry.identity.model or "",
                serial=entry.identity.serial or "", is_serial_line=address.is_serial_line,
            )  # fmt: skip
            self.instrument = make_instrument(self.description.simulator, setup)
        self.line = BadLine(1, lambda _number: self.instrument.faults.on_the_line())

    @property
    def safe_within_s(self) -> float:
        """The time within which `make_safe` ends: that of the description, and some for the line."""
        entry = self.entry
        return self.description.safe_state_of(entry.options, entry.limits, entry.safe).within_s + SAFE_SLACK_S

    def driver(self, pin: IdentityPin | None = None) -> Device:
        """A new driver, not yet connected."""
        entry = self.entry
        setup = Setup(NAME, entry.connection, self, entry.options, entry.limits, entry.safe, pin or entry.identity)
        return make_driver(self.description, setup)

    async def stream(self, device: str, address: Address, factory: Callable[[], P]) -> P:
        """Joins `factory()` to the simulator."""
        if isinstance(self.instrument, CanNode):
            raise CannotConnect(device, f"{address} carries frames only")
        client = factory()
        join(client, self.line.in_front_of(protocol_factory(self.instrument))(), Line(latency_s=0.001), str(address))
        return client

    async def frames(self, device: str, address: Address) -> FrameLink:
        """The frames of a simulator that sends them by itself."""
        if isinstance(self.instrument, CanNode):
            return self.instrument
        raise CannotConnect(device, f"{address} carries no frames")

    @contextmanager
    def suffering(self, kind: FaultKind) -> Iterator[None]:
        """A fault is there, and then no longer."""
        begin(self.instrument, kind)
        yield
        end(self.instrument, kind)


async def identifies_itself(subject: Subject) -> None:
    """The identity is complete, and the same when queried again."""
    async with subject.driver() as driver:
        found = await driver.identify()
        _that(bool(found.maker or found.model or found.fingerprint), "identify() tells neither maker nor model")
        _that(await driver.identify() == found, "identify() tells somebody else the second time")


async def refuses_another(subject: Subject) -> None:
    """A serial number that differs from the bench file is refused, if the instrument reports one."""
    async with subject.driver() as driver:
        verified = (await driver.identify()).verified
    if verified:
        try:
            async with subject.driver(IdentityPin(serial="another")):
                raise AssertionError("an instrument with another serial number is taken for the right one")
        except WrongIdentity:
            pass


async def reads_what_it_promises(subject: Subject) -> None:
    """`poll` returns finite values of exactly the channels in the description."""
    promised = subject.description.channels_of(subject.entry.options)
    async with subject.driver() as driver:
        found = await driver.poll()
    _that(set(found) <= set(promised), f"poll() gives {sorted(set(found) - set(promised))}, which channels do not name")
    values = [reading.value for readings in found.values() for reading in readings]
    _that(all(map(math.isfinite, values)), f"poll() gives a value that is no number: {values}")


async def tells_silence(subject: Subject) -> None:
    """A silent instrument is reported in bounded time, and works again afterwards."""
    async with subject.driver() as driver:
        for kind in ("silent", "cut"):
            with subject.suffering(kind):
                _that(await _refused(driver.poll()), f"{kind}: poll() gives readings although nobody answers")
            await _heals(driver, kind)


async def bears_every_line(subject: Subject) -> None:
    """Every line fault is tolerated or raised as a DriverError, and the driver recovers after it.

    `half_open` does not exist on a serial port and is skipped there.
    """
    left_out = {"half_open"} if subject.entry.connection.is_serial_line else set()
    async with subject.driver() as driver:
        for kind in (kind for kind in LINE_FAULTS if kind not in left_out):
            with subject.suffering(kind):
                await _refused(driver.poll())
            await _heals(driver, kind)


async def bears_every_mishap(subject: Subject) -> None:
    """Whatever happens to the instrument is borne, or raised as a DriverError, also by `make_safe`."""
    for kind in mishaps_of(type(subject.instrument)):
        async with subject.driver() as driver:
            with subject.suffering(kind):
                await _refused(driver.poll())
                await _refused(driver.make_safe(), subject.safe_within_s)
            with suppress(DriverError):
                await driver.make_safe()


async def is_made_safe(subject: Subject) -> None:
    """`make_safe` may be called twice, reconnects after a lost connection, and otherwise fails in bounded time."""
    within_s = subject.safe_within_s
    async with subject.driver() as driver:
        for _ in range(2):
            _that(not await _refused(driver.make_safe(), within_s), "make_safe() fails on a healthy instrument")
        for kind in ("silent", "cut"):
            with subject.suffering(kind):
                _that(await _refused(driver.make_safe(), within_s), f"{kind}: make_safe() says that it has worked")
        await asyncio.sleep(HEALS_AFTER_S)
        _that(not await _refused(driver.make_safe(), within_s), "make_safe() does not connect again")


async def leaves_quietly(subject: Subject) -> None:
    """Leaving closes the wire and sends nothing; leaving twice is harmless."""
    driver = subject.driver()
    async with driver:
        await driver.poll()
        answered = subject.line.answers
    await driver.__aexit__(None, None, None)
    await asyncio.sleep(HEALS_AFTER_S)
    _that(subject.line.answers == answered, "the instrument is still spoken to after the driver was left")


CHECKS: Mapping[str, Callable[[Subject], Awaitable[None]]] = {
    each.__name__: each
    for each in (
        identifies_itself, refuses_another, reads_what_it_promises, tells_silence, bears_every_line,
        bears_every_mishap, is_made_safe, leaves_quietly,
    )
}  # fmt: skip


# Those for a device that only sends frames: it has no line to answer on, and is silent only after some time.
CHECKS_OF_FRAMES = ("identifies_itself", "reads_what_it_promises", "bears_every_mishap", "leaves_quietly")


def check(name: str, entry: Mapping[str, object], description: DriverDescription | None = None) -> None:
    """Run one of CHECKS on a device entry of a bench file; AssertionError."""
    device = DeviceEntry.model_validate(entry)

    async def main() -> None:
        await CHECKS[name](Subject(device, description))

    run_loop(main(), AS_FAST_AS_POSSIBLE)


async def _refused(doing: Awaitable[object], within_s: float = ANSWERS_WITHIN_S) -> bool:
    """Whether it raises a DriverError; AssertionError for any other, and when it takes too long."""
    try:
        async with asyncio.timeout(within_s):
            await doing
    except DriverError:
        return True
    except TimeoutError:
        raise AssertionError(f"nothing comes back within {within_s:g} s") from None
    except Exception as error:
        raise AssertionError(f"{type(error).__name__} reaches the caller, expected a DriverError: {error}") from error
    return False


async def _heals(driver: Device, after: str) -> None:
    for _ in range(HEALS_IN_POLLS):
        await asyncio.sleep(HEALS_AFTER_S)
        if not await _refused(driver.poll()):
            return
    raise AssertionError(f"after {after} it does not come back, though the line is good again")


def _that(kept: bool, otherwise: str) -> None:
    if not kept:
        raise AssertionError(otherwise)
