"""Every dialect of a chamber's controller, as the tests that all of them pass need it; `instruments.py` lists them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass, field
from typing import Any

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.description import DriverDescription, IdentityPin, Setup, known_drivers, make_driver
from drivers.dialects.watlow_f4t.wire import ControlMode, LoopFormat, LoopRegister
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe, safe_state
from drivers.kinds.chamber.driver import Chamber
from drivers.transport.address import Address
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.setup import InstrumentSetup, make_instrument
from simulators.physics.thermal import ChamberPhysics
from simulators.units.settings import WorldSettings
from simulators.world import World
from tests.support.handling import is_modbus_query, is_modbus_tcp_query
from tests.support.lines import TappedWire

LIMITS = {"temperature": {"min": "-50 °C", "max": "100 °C"}, "ramp_rate": {"max": "3 °C/min"}}
START_C = 20.0


@dataclass(frozen=True)
class Dialect:
    """One driver at one kind of address, and what somebody at the front panel of its simulator may do.

    `commands` tells the requests that write a set point, `asks` those that only ask. `stranger` makes the simulator
    another chamber of its kind. `take_over` makes it follow something else, `switch_off` nothing. `gives_back` says
    whether making safe ends that. `limits` makes the controller's own -40.1 to 80.1 °C, where it has its own.
    `switched_on` says whether a ramp starts a chamber that is off. `within_c` is how far a set point may be off at a
    given moment of a ramp.
    """

    driver: str
    address: str
    commands: Callable[[bytes], bool]
    asks: Callable[[bytes], bool]
    set_point: Callable[[Any, float], None]
    take_over: Callable[[Any], None]
    switch_off: Callable[[Any], None]
    stranger: Callable[[Any], None]
    gives_back: bool = True
    switched_on: bool = True
    limits: Callable[[Any], None] | None = None
    options: Mapping[str, object] = field(default_factory=dict)
    prepare: Callable[[Any], None] = lambda _instrument: None
    within_c: float = 0.02
    name: str = ""

    def __str__(self) -> str:
        return self.name or f"{self.driver}-{self.address.partition(':')[0]}"

    @property
    def description(self) -> DriverDescription:
        return known_drivers()[self.driver]


class Rig:
    """A simulated chamber whose air begins at START_C, at the end of a tapped wire."""

    def __init__(self, dialect: Dialect) -> None:
        self.dialect = dialect
        self.address = Address.parse(dialect.address)
        self.options = dialect.description.options.model_validate(dict(dialect.options))
        self.now_s = asyncio.get_running_loop().time
        self.faults = FaultPlan(now_s=self.now_s)
        self.world = World(WorldSettings(1, 9.8, chamber=ChamberPhysics(start_c=START_C)), self.now_s)
        setup = InstrumentSetup(
            "chamber", self.world, self.faults, self.options, is_serial_line=self.address.is_serial_line
        )
        self.instrument: Any = make_instrument(dialect.description.simulator, setup)
        dialect.prepare(self.instrument)
        self.wire = TappedWire(self.instrument)
        self.notes: list[str] = []

    def driver(self, *, safe: object = None, pin: object = None) -> Chamber:
        setup = Setup(
            name="chamber", address=self.address, wires=self.wire, options=self.options,
            limits=ChamberLimits.model_validate(LIMITS), safe=ChamberSafe.model_validate(safe or {}),
            identity=IdentityPin.model_validate(pin or {}), note=self.notes.append,
        )  # fmt: skip
        driver = make_driver(self.dialect.description, setup)
        assert isinstance(driver, Chamber)
        return driver

    @property
    def safe_within_s(self) -> float:
        return safe_state(self.options, ChamberLimits.model_validate(LIMITS), ChamberSafe()).within_s

    def set_point_c(self) -> float:
        self.world.look()
        return self.world.thermal.set_point_c

    def air_c(self) -> float:
        self.world.look()
        return self.world.thermal.air_c

    def commands(self) -> list[bytes]:
        """The requests so far that write a set point."""
        return [request for request in self.wire.requests if self.dialect.commands(request)]


def with_rig(dialect: Dialect, use: Callable[[Rig], Coroutine[Any, Any, None]]) -> None:
    async def main() -> None:
        await use(Rig(dialect))

    run(main(), AS_FAST_AS_POSSIBLE)


# Watlow F4T


def _f4t_writes(register: int, at: int) -> Callable[[bytes], bool]:
    return lambda request: request[at] in (6, 16) and request[at + 1 : at + 3] == register.to_bytes(2, "big")


def _f4t_set(register: LoopRegister, *words: int) -> Callable[[Any], None]:
    return lambda f4t: f4t.write(register, words)


def _f4t_limits(low_c: float, high_c: float) -> Callable[[Any], None]:
    def set_limits(f4t: Any) -> None:
        for register, value in ((LoopRegister.SET_POINT_MIN, low_c), (LoopRegister.SET_POINT_MAX, high_c)):
            f4t.write(register, LoopFormat().words(value))

    return set_limits


def _f4t(address: str, function_at: int) -> Dialect:
    return Dialect(
        driver="watlow_f4t", address=address,
        commands=_f4t_writes(LoopRegister.SET_POINT, function_at),
        asks=is_modbus_tcp_query if address.startswith("tcp:") else is_modbus_query,
        set_point=lambda f4t, value_c: f4t.write(LoopRegister.SET_POINT, LoopFormat().words(value_c)),
        take_over=_f4t_set(LoopRegister.CONTROL_MODE, ControlMode.MANUAL),
        switch_off=_f4t_set(LoopRegister.CONTROL_MODE, ControlMode.OFF),
        stranger=_f4t_limits(-60.0, 150.0), limits=_f4t_limits(-40.1, 80.1), gives_back=False, switched_on=False,
    )  # fmt: skip


F4T_DIALECTS = (
    _f4t("tcp://127.0.0.1:502", 7),
    _f4t("socket://127.0.0.1:4001", 1),
    _f4t("serial:///dev/ttyUSB0?baud=9600", 1),
)
