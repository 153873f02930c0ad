"""The dialects of chambers' controllers that speak in lines or frames of text, for the tests that all chambers pass."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from simulators.faults.instrument_faults import FaultPlan
from simulators.world import World
from tests.support.chambers import Dialect
from tests.support.clock import Clock, quiet_chamber
from tests.support.handling import asks_by, is_cts_query, is_scpi_query

S = TypeVar("S", covariant=True)


class Simulator(Protocol[S]):
    """The class of a simulated chamber."""

    def __call__(self, world: World, faults: FaultPlan, **settings: Any) -> S: ...


def at_25_c(simulator: Simulator[S], clock: Clock, **settings: object) -> S:
    """A simulated chamber whose air is at 25 °C and stands still."""
    return simulator(quiet_chamber(clock, 25.0), FaultPlan(now_s=clock), **settings)


def _beginning(*commands: bytes) -> Callable[[bytes], bool]:
    return lambda request: request.startswith(commands)


def _told(*messages: str) -> Callable[[Any], None]:
    """Messages of somebody else to a controller, which takes them."""

    def tell(instrument: Any) -> None:
        for message in messages:
            instrument.execute(message)

    return tell


P300 = Dialect(
    driver="espec_p300", address="tcp://127.0.0.1:10001",
    commands=_beginning(b"TEMP, S"), asks=is_scpi_query,
    set_point=lambda p300, value_c: _told(f"TEMP, S{value_c:.1f}")(p300),
    take_over=_told("PRGM,RUN,RAM:1,STEP1"), switch_off=_told("MODE,OFF"),
    stranger=lambda p300: setattr(p300, "_kind", "S1"), limits=_told("TEMP, H80.1 L-40.1"),
    within_c=0.5,
)  # fmt: skip

SIMSERV = Dialect(
    driver="simserv", address="tcp://127.0.0.1:2049",
    commands=_beginning(b"11001"),
    asks=asks_by(rb"(?:10012|11002|11004|11007|11009|11023|11066|11070|14003|17002|17007|17009|19210|99997)\xb6"),
    set_point=lambda simserv, value_c: _told(f"11001¶1¶1¶{value_c:.1f}")(simserv),
    take_over=_told("19014¶1¶1¶1"), switch_off=_told("14001¶1¶1¶0"),
    stranger=lambda simserv: setattr(simserv, "serial", "59226002"),
    limits=lambda simserv: setattr(simserv, "limits_c", (-40.1, 80.1)), within_c=0.1,
    prepare=lambda simserv: setattr(simserv, "serial", "SIM-01"),
)  # fmt: skip


def _cts(ramp_channel: int, set_point_reads: str) -> Dialect:
    return Dialect(
        name=f"cts-{set_point_reads}", driver="cts", address="serial:///dev/ttyUSB0?baud=19200&parity=O",
        options={"ramp_channel": ramp_channel},
        commands=_beginning(bytes.fromhex("02 81 e1 b0")), asks=is_cts_query,
        set_point=lambda cts, value_c: _told(f"a0 {value_c:05.1f}")(cts),
        take_over=_told("s3 0"), switch_off=_told("s1 0"),
        stranger=lambda cts: setattr(cts, "versions", "2.41;1.07;123457"), within_c=0.1,
        prepare=lambda cts: setattr(cts, "_reads", set_point_reads),
    )  # fmt: skip


CTS, CTS_TARGET = _cts(1, "in_force"), _cts(0, "target")
