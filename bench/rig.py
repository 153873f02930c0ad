"""Opened devices of a bench: access by role; opening and making safe in parallel, closing in reverse order."""

# mypy: disable-error-code=type-abstract
# `Rig._device` does not construct the protocols that it is given

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Collection, Mapping
from contextlib import AsyncExitStack
from types import MappingProxyType
from typing import Any, Self, TypeVar, cast

from bench.config.devices import DeviceEntry
from bench.config.models import BenchFile
from bench.errors import BenchError
from drivers.capabilities import Device, FrameSource, Meter, Positioner, PulseCounter, RateTable, Source, ThermalChamber
from drivers.description import Setup, ignore_note, make_driver
from drivers.errors import DriverError, Refused, WrongIdentity
from drivers.person import NO_OPERATOR, Person
from drivers.timing.awake import fair_timeout
from drivers.transport.wires import Wires
from drivers.values import Identity

T = TypeVar("T")

MAKE_SAFE_S = 10.0  # for a device without a known limit
OWN_LIMIT_S = 2.0  # beyond the limit of a driver, so that its own error comes first
OPEN_S = 30.0
CLOSE_S = 10.0
HOLD_S = 5.0  # to check a chamber and stop it at its present set point
GRACE_S = 1.0  # for a cancelled operation, beyond its limit


class OpenError(BenchError):
    """Failure to open some devices; one line for each."""

    code = "open"


class Rig:
    """Devices of a bench.

    Lifetime: inside the context every device is connected and identified, or `OpenError` names all that failed. Leaving
    it closes them without making them safe; `make_safe` does that. Callers that need the partly opened devices call
    `open` and `close`. `not_reached` are devices that could not be opened or have another identity than in the bench
    file; they are not in `devices`, and nothing is sent to them. `limits_s` are the time limits of making safe, by
    role. `held` are chambers that `make_safe` has left at their set point. If the bench is locked out when it is made
    safe, outputs are switched off and everything else is stopped.
    """

    def __init__(
        self, devices: Mapping[str, Device], limits_s: Mapping[str, float] = MappingProxyType({}),
        is_locked_out: Callable[[], bool] = lambda: False,
    ) -> None:  # fmt: skip
        self.devices = dict(devices)
        self._is_locked_out = is_locked_out
        self._limits_s = dict.fromkeys(devices, MAKE_SAFE_S) | dict(limits_s)
        self.identities: dict[str, Identity] = {}
        self.not_reached: dict[str, str] = {}
        self.held: set[str] = set()
        self._checked: dict[tuple[str, type], Device] = {}  # devices known to be of a kind
        self._open = AsyncExitStack()

    async def __aenter__(self) -> Self:
        """Open all devices in parallel; if that fails or is cancelled, close those that are open."""
        try:
            await self.open()
        except BaseException:
            await self.close()
            raise
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Close the devices in reverse order."""
        await self.close()

    async def open(self, needed: Collection[str] | None = None) -> None:
        """Open and identify all devices in parallel. Raises OpenError if one of `needed`, by default any, fails.

        Opened devices stay open, also after an error or a cancellation.
        """
        opened: list[Device] = []

        async def enter(device: Device) -> None:
            await self._open.enter_async_context(device)
            opened.append(device)

        try:
            failed = _failed(await self._each(enter, OPEN_S))
        except asyncio.CancelledError:
            closed = [role for role, device in self.devices.items() if not any(device is each for each in opened)]
            self._leave_out({role: f"{role}: its opening was cancelled" for role in closed})
            raise
        self._leave_out(failed)
        _check(failed, needed)
        identities = await self._each(lambda device: device.identify(), OPEN_S)
        failed = _failed(identities)
        exchanged = {role for role, found in identities.items() if isinstance(found, WrongIdentity)}
        self._leave_out({role: why for role, why in failed.items() if role in exchanged})
        _check(failed, needed)
        self._leave_out(failed)
        self.identities = {name: found for name, found in identities.items() if isinstance(found, Identity)}

    def _leave_out(self, failed: Mapping[str, str]) -> None:
        self.not_reached |= failed
        for role in failed:
            self.devices.pop(role, None)

    async def close(self) -> None:
        """Close the devices in reverse order, within `CLOSE_S`; one that cannot be closed is abandoned."""
        closing = asyncio.create_task(self._open.aclose(), name="closing")
        await asyncio.wait([closing], timeout=CLOSE_S)
        if not closing.done():
            closing.cancel()
        elif not closing.cancelled() and isinstance(problem := closing.exception(), Exception):
            raise problem

    def positioner(self, role: str) -> Positioner:
        """Return the device of a role as a positioner; checked plans request only matching roles."""
        return self._device(role, Positioner)

    def table(self, role: str) -> RateTable:
        """Return the device of a role as a rate table."""
        return self._device(role, RateTable)

    def chamber(self, role: str) -> ThermalChamber:
        """Return the device of a role as a thermal chamber."""
        return self._device(role, ThermalChamber)

    def source(self, role: str) -> Source:
        """Return the device of a role as a supply or current source."""
        return self._device(role, Source)

    def counter(self, role: str) -> PulseCounter:
        """Return the device of a role as a pulse counter."""
        return self._device(role, PulseCounter)

    def frame_source(self, role: str) -> FrameSource:
        """Return the device of a role as a source of frames: a pulse counter, or telemetry."""
        return self._device(role, FrameSource)

    def meter(self, role: str) -> Meter:
        """Return the device of a role as a voltmeter or ammeter."""
        return self._device(role, Meter)

    def _device(self, role: str, kind: type[T]) -> T:
        """Return the device of a role. Raises TypeError unless it is of a kind; the checks of a plan prevent this."""
        device = self.devices[role]
        if self._checked.get((role, kind)) is not device:  # kinds are protocols: every member of them is looked up
            if not isinstance(device, kind):
                raise TypeError(f"{role} is not a {kind.__name__}")
            self._checked[role, kind] = device
        return cast(T, device)

    @property
    def safe_within_s(self) -> float:
        """Time limit of `make_safe` in s."""
        return max(self._limits_s.values(), default=0.0) + 2 * GRACE_S

    async def make_safe(self, hold: Collection[str] = ()) -> dict[str, str]:
        """Make every device safe, in parallel, each within its limit; return the errors by role.

        Chambers in `hold` stay at their set point if they are in order.
        """
        only_off = self._is_locked_out()
        held = [self.devices[role] for role in hold if role in self.devices]

        async def act(device: Device) -> bool:
            return await make_safe_or_hold(device, only_off=only_off, hold=device in held)

        ended = await self._each(act, self._limits_s)
        self.held = {role for role, held in ended.items() if held is True}
        return _failed(ended)

    async def _each(
        self, act: Callable[[Device], Awaitable[object]], limits_s: float | Mapping[str, float]
    ) -> dict[str, object]:
        """Return the result or exception of `act` for each device; one that fails or hangs does not delay the others.

        One that does not end even when cancelled is abandoned.
        """
        limit_of = limits_s if isinstance(limits_s, Mapping) else dict.fromkeys(self.devices, limits_s)
        longest_s = max((limit_of[name] for name in self.devices), default=0.0)

        async def one(name: str, device: Device) -> object:
            limit_s = limit_of[name]
            try:
                async with fair_timeout(limit_s):
                    return await act(device)
            except DriverError as problem:
                return problem
            except TimeoutError:
                return TimeoutError(f"{name}: not finished within {limit_s:g} s")
            except Exception as problem:  # noqa: BLE001  the other devices are made safe all the same
                return RuntimeError(f"{name}: {type(problem).__name__}: {problem}")

        tasks = {name: asyncio.create_task(one(name, device), name=name) for name, device in self.devices.items()}
        if not tasks:
            return {}
        try:
            await asyncio.wait(tasks.values(), timeout=longest_s + GRACE_S)
        finally:
            if slow := [task for task in tasks.values() if not task.done()]:
                for task in slow:
                    task.cancel()
                await asyncio.wait(slow, timeout=GRACE_S)
        stuck = TimeoutError(f"not finished within {longest_s:g} s, and its driver does not end")
        return {name: task.result() if task.done() and not task.cancelled() else stuck for name, task in tasks.items()}


async def make_safe_or_hold(device: Device, *, only_off: bool, hold: bool = False) -> bool:
    """Make a device safe; return True if it is a chamber that is held instead.

    With `hold` a chamber in order is stopped at its present set point. With `only_off` every chamber is, and Refused
    names the set point.
    """
    if not (only_off and isinstance(device, ThermalChamber)):
        if hold and isinstance(device, ThermalChamber) and await _is_held(device):
            return True
        await device.make_safe()
        return False
    await device.hold()
    state = await device.state()
    raise Refused(
        device.name, f"was stopped at a set point of {state.target_c:g} °C, since somebody works at the bench",
        remedy="When the lockout is lifted: bench make-safe.",
    )  # fmt: skip


def _failed(results: Mapping[str, object]) -> dict[str, str]:
    """Return the devices with an exception, with its text."""
    return {name: str(result) for name, result in results.items() if isinstance(result, BaseException)}


def _check(failed: Mapping[str, str], needed: Collection[str] | None) -> None:
    """Raise OpenError with all failed devices, if one of them is needed."""
    if failed and (needed is None or set(needed) & failed.keys()):
        raise OpenError("\n".join(failed.values()))


async def _is_held(chamber: ThermalChamber) -> bool:
    """Stop a chamber at its present set point; return False if it does not answer or is not in order."""
    try:
        async with fair_timeout(HOLD_S):
            await chamber.state()
            await chamber.hold()
    except (DriverError, TimeoutError):
        return False
    return True


def limits_to_make_safe(bench: BenchFile) -> dict[str, float]:
    """Return the time limit in s for making each device of a bench safe, by role."""
    states = {role: entry.safe_state for role, entry in bench.devices.items()}
    return {role: state.within_s + OWN_LIMIT_S + HOLD_S * bool(state.hold_s) for role, state in states.items()}


def device_of(
    role: str,
    entry: DeviceEntry,
    wires: Wires,
    note: Callable[[str], object] = ignore_note,
    person: Person = NO_OPERATOR,
) -> Device:
    """Return the driver of one device on these wires, not yet connected."""
    setup: Setup[Any, Any, Any] = Setup(
        role, entry.connection, wires, entry.options, entry.limits, entry.safe, entry.identity, note, person
    )
    return make_driver(entry.description, setup)
