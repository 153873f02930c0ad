"""Contract of all drivers with a communication line, as checks that a plug-in runs on its own simulator.

    @pytest.mark.parametrize("name", CHECKS)
    def test_the_contract_of_every_driver(name):
        check(name, {"driver": "my_chamber", "connection": "tcp://127.0.0.1:5025", "limits": {...}})

A check runs the real driver on its simulator in virtual time, and raises AssertionError with the violated part.
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
from simulators.faults.instrument_faults import LINE_FAULTS, FaultKind, FaultPlan, begin, end, fault_effects_of
from simulators.faults.line_faults import FaultyLine
from simulators.instruments.can_nodes.can_node import CanNode, NodeSetup, make_node
from simulators.instruments.setup import InstrumentSetup, make_instrument
from simulators.serving.serve import Instrument, protocol_factory
from simulators.units.settings import WorldSettings
from simulators.world import World

P = TypeVar("P", bound=asyncio.Protocol)
NAME = "subject"
ANSWERS_WITHIN_S = 60.0
SAFE_SLACK_S = 0.1
HEALS_IN_POLLS, HEALS_AFTER_S = 3, 40.0  # lost connections are retried after up to half a minute


class Subject:
    """Driver and its simulator on a line in memory; create it in the running loop.

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
        self.line = FaultyLine(1, lambda _number: self.instrument.faults.on_the_line())

    @property
    def safe_within_s(self) -> float:
        """Time limit of `make_safe` in s: that of the description, with an allowance for the line."""
        entry = self.entry
        return self.description.safe_state_of(entry.options, entry.limits, entry.safe).within_s + SAFE_SLACK_S

    def driver(self, pin: IdentityPin | None = None) -> Device:
        """Return a new driver, not yet connected."""
        entry = self.entry
        setup = Setup(NAME, entry.connection, self, entry.options, entry.limits, entry.safe, pin or entry.identity)
        return make_driver(self.description, setup)

    async def stream(self, device: str, address: Address, factory: Callable[[], P]) -> P:
        """Join `factory()` to the simulator."""
        if isinstance(self.instrument, CanNode):
            raise CannotConnect(device, f"{address} carries frames only")
        client = factory()
        join(client, self.line.server(protocol_factory(self.instrument))(), Line(latency_s=0.001), str(address))
        return client

    async def frames(self, device: str, address: Address) -> FrameLink:
        """Return the frames of a simulator that sends them unsolicited."""
        if isinstance(self.instrument, CanNode):
            return self.instrument
        raise CannotConnect(device, f"{address} carries no frames")

    @contextmanager
    def fault(self, kind: FaultKind) -> Iterator[None]:
        """Inject a fault during the block."""
        begin(self.instrument, kind)
        yield
        end(self.instrument, kind)


async def identifies_itself(subject: Subject) -> None:
    """Check that the identity is complete, and the same when queried again."""
    async with subject.driver() as driver:
        found = await driver.identify()
        _expect(bool(found.maker or found.model or found.fingerprint), "identify() returns neither maker nor model")
        _expect(await driver.identify() == found, "identify() returns another identity the second time")


async def refuses_other_serial(subject: Subject) -> None:
    """Check that a serial number that differs from the bench file is refused, if the instrument reports one."""
    async with subject.driver() as driver:
        verified = (await driver.identify()).verified
    if verified:
        try:
            async with subject.driver(IdentityPin(serial="another")):
                raise AssertionError("an instrument with another serial number is accepted")
        except WrongIdentity:
            pass


async def reads_described_channels(subject: Subject) -> None:
    """Check that `poll` returns finite values, and only of channels in the description."""
    promised = subject.description.channels_of(subject.entry.options)
    async with subject.driver() as driver:
        found = await driver.poll()
    _expect(set(found) <= set(promised), f"poll() returns {sorted(set(found) - set(promised))}, not among the channels")
    values = [reading.value for readings in found.values() for reading in readings]
    _expect(all(map(math.isfinite, values)), f"poll() returns a value that is not finite: {values}")


async def reports_silence(subject: Subject) -> None:
    """Check that a silent instrument is reported in bounded time, and works again afterwards."""
    async with subject.driver() as driver:
        for kind in ("silent", "cut"):
            with subject.fault(kind):
                _expect(await _refused(driver.poll()), f"{kind}: poll() returns readings from a silent instrument")
            await _expect_recovery(driver, kind)


async def survives_line_faults(subject: Subject) -> None:
    """Check that line faults are tolerated or raised as DriverError, and that the driver recovers.

    `half_open` does not exist on a serial port and is skipped there.
    """
    left_out = {"half_open"} if subject.entry.connection.is_serial_line else set()
    async with subject.driver() as driver:
        for kind in (kind for kind in LINE_FAULTS if kind not in left_out):
            with subject.fault(kind):
                await _refused(driver.poll())
            await _expect_recovery(driver, kind)


async def survives_faults(subject: Subject) -> None:
    """Check that instrument faults are tolerated or raised as DriverError, also by `make_safe`."""
    for kind in fault_effects_of(type(subject.instrument)):
        async with subject.driver() as driver:
            with subject.fault(kind):
                await _refused(driver.poll())
                await _refused(driver.make_safe(), subject.safe_within_s)
            with suppress(DriverError):
                await driver.make_safe()


async def is_made_safe(subject: Subject) -> None:
    """Check that `make_safe` may be called twice, reconnects, and otherwise fails in bounded time."""
    within_s = subject.safe_within_s
    async with subject.driver() as driver:
        for _ in range(2):
            _expect(not await _refused(driver.make_safe(), within_s), "make_safe() fails on a healthy instrument")
        for kind in ("silent", "cut"):
            with subject.fault(kind):
                _expect(await _refused(driver.make_safe(), within_s), f"{kind}: make_safe() reports success")
        await asyncio.sleep(HEALS_AFTER_S)
        _expect(not await _refused(driver.make_safe(), within_s), "make_safe() does not connect again")


async def closes_quietly(subject: Subject) -> None:
    """Check that leaving closes the wire and sends nothing, and that leaving twice is harmless."""
    driver = subject.driver()
    async with driver:
        await driver.poll()
        answered = subject.line.answers
    await driver.__aexit__(None, None, None)
    await asyncio.sleep(HEALS_AFTER_S)
    _expect(subject.line.answers == answered, "bytes are still sent after the driver was closed")


CHECKS: Mapping[str, Callable[[Subject], Awaitable[None]]] = {
    each.__name__: each
    for each in (
        identifies_itself, refuses_other_serial, reads_described_channels, reports_silence, survives_line_faults,
        survives_faults, is_made_safe, closes_quietly,
    )
}  # fmt: skip


# checks of a device that only sends frames: it answers no query, and is reported as silent only after some time
CHECKS_OF_FRAMES = ("identifies_itself", "reads_described_channels", "survives_faults", "closes_quietly")


def check(name: str, entry: Mapping[str, object], description: DriverDescription | None = None) -> None:
    """Run one of CHECKS on a device entry of a bench file. Raises AssertionError."""
    device = DeviceEntry.model_validate(entry)

    async def main() -> None:
        await CHECKS[name](Subject(device, description))

    run_loop(main(), AS_FAST_AS_POSSIBLE)


async def _refused(doing: Awaitable[object], within_s: float = ANSWERS_WITHIN_S) -> bool:
    """Return True if a DriverError is raised; AssertionError for any other exception and on a timeout."""
    try:
        async with asyncio.timeout(within_s):
            await doing
    except DriverError:
        return True
    except TimeoutError:
        raise AssertionError(f"no result within {within_s:g} s") from None
    except Exception as error:
        raise AssertionError(f"{type(error).__name__} reaches the caller, expected a DriverError: {error}") from error
    return False


async def _expect_recovery(driver: Device, after: str) -> None:
    for _ in range(HEALS_IN_POLLS):
        await asyncio.sleep(HEALS_AFTER_S)
        if not await _refused(driver.poll()):
            return
    raise AssertionError(f"after {after} the driver does not recover, though the line works again")


def _expect(kept: bool, otherwise: str) -> None:
    if not kept:
        raise AssertionError(otherwise)
