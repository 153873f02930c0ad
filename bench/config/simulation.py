"""Simulated instruments and units of a bench file; a real bench needs none of it."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, ClassVar, Literal, get_args

from pydantic import Field, model_validator

from drivers.schema.fields import (
    Arcseconds,
    Celsius,
    FileBeside,
    Hertz,
    Instant,
    InUnit,
    Name,
    PositiveSeconds,
    Ratio,
    Seconds,
    StrictModel,
    WholeNumber,
)
from drivers.schema.wording import telling

DeviceFault = Literal[
    "silent", "cut", "delay", "late", "duplicate", "garbage", "cut_short", "split", "flip", "echo", "half_open",
    "slow_close", "frozen", "stuck", "lag", "restart", "door_open", "emergency_stop", "front_panel", "program",
    "interlock", "compliance", "tripped", "alarm", "open_sensor",
    "lost_frames", "lost_bursts", "doubled_frames", "late_frames", "foreign_frames", "short_frames", "swapped_frames",
    "error_frames", "bus_off", "stuck_count", "cleared_count",
    "heater_dead", "cooling_dead", "runaway", "detached_sensor", "slow",
]  # fmt: skip
UnitFault = Literal["silent", "dead", "open_thermometer", "current", "detached_thermometer"]
AnyFault = Literal[DeviceFault, UnitFault]


class ChamberSimulation(StrictModel):
    """Behaviour of the simulated chamber."""

    start: Celsius = Field(20.0, description="of the air when a run begins")
    natural_period: PositiveSeconds = Field(360.0, description="of the control loop")
    damping: Annotated[Ratio, InUnit("", above=0, at_most=5)] = Field(
        0.5, description="of the control loop; 1 is critical"
    )
    limit_cycle: Annotated[float, InUnit("°C", at_least=0)] = Field(
        0.2, description="root mean square of how the air swings at rest"
    )
    limit_cycle_period: PositiveSeconds = Field(90.0, description="period of that swing")


class HeadSimulation(StrictModel):
    """Behaviour of the simulated head."""

    backlash: Arcseconds = Field(
        1.0, description="between its two directions, where its certificate states none to draw it from"
    )
    acceleration: Annotated[float, InUnit("°/s²", above=0)] = Field(40.0, description="of every move")


class TableSimulation(StrictModel):
    """Behaviour of a simulated rate table."""

    loop: Hertz = Field(150.0, description="natural frequency of its control loop")
    damping: Annotated[Ratio, InUnit("", above=0, at_most=5)] = Field(0.7, description="of its control loop")
    torque: Annotated[float, InUnit("N·m", above=0)] = Field(640.0, description="the most that its motor gives")
    inertia: Annotated[float, InUnit("kg·m²", above=0)] = Field(0.3, description="of the table and its load")
    rate: Annotated[Ratio, InUnit("", at_least=0)] = Field(
        1e-4, description="standard deviation of its relative rate error, the same at every rate"
    )
    ripple: Annotated[Ratio, InUnit("", at_least=0)] = Field(
        1e-4, description="of its rate, over a turn: once, twice, and twice for each pair of poles"
    )
    pole_pairs: Annotated[WholeNumber, Field(ge=1, le=100)] = Field(12, description="of its motor")


class ThermometerSimulation(StrictModel):
    """Behaviour of the simulated thermometers at the units."""

    noise: Annotated[float, InUnit("°C", at_least=0)] = Field(0.005, description="standard deviation of a reading")
    lag: PositiveSeconds = Field(20.0, description="time constant behind the unit")


class VoltmeterSimulation(StrictModel):
    """Connection of a simulated voltmeter: a resistor that carries the current of a unit."""

    place: Name | None = Field(None, description="of the unit; without one no current flows through it")
    load: Annotated[float, InUnit("Ω", above=0)] = Field(description="the resistor")
    noise: Annotated[float, InUnit("V", at_least=0)] = Field(
        0.0, description="standard deviation of a reading over 10 line cycles; it falls with the root of their number"
    )


class AmmeterSimulation(StrictModel):
    """Noise of a simulated ammeter; the places define its connection."""

    noise: Annotated[float, InUnit("A", at_least=0)] = Field(
        0.0, description="standard deviation of a reading over 10 line cycles; it falls with the root of their number"
    )


class SourceSimulation(StrictModel):
    """Errors of a simulated current source: standard deviations, in place of or in addition to a certificate."""

    gain: Annotated[Ratio, InUnit("", at_least=0)] = Field(0.0, description="of the current")
    offset: Annotated[float, InUnit("A", at_least=0)] = Field(0.0, description="the same at every current")
    drift: Annotated[float, InUnit("1/h", at_least=0)] = Field(0.0, description="of the current in an hour")
    warm_up: PositiveSeconds = Field(7200.0, description="time after power-on in which it drifts faster")
    fresh: Annotated[Ratio, InUnit("", at_least=1)] = Field(
        5.0, description="factor by which it drifts faster until then"
    )


class FaultSimulation(StrictModel):
    """Deliberate fault of an instrument, or of a unit under test.

    Effects of each kind: [rehearse a bad night](../how-to/rehearse_a_bad_night.md).
    """

    kind_key: ClassVar[str] = "kind"

    device: Name | None = Field(None, description="the instrument, as in devices")
    unit: Name | None = Field(None, description="or the place of the unit")
    kind: AnyFault = Field(description="kind of fault; not every instrument supports every kind")
    at: Seconds = Field(description="when, after the beginning of the run, or after the step has ended")
    after: str | None = Field(None, description="the id of that step, as `bench plan` lists it")
    for_: PositiveSeconds | None = Field(None, alias="for", description="how long it lasts; without it, to the end")

    @model_validator(mode="after")
    def _of_a_device_or_a_unit(self) -> FaultSimulation:
        if (self.device is None) == (self.unit is None):
            raise telling("give either device or unit")
        allowed = get_args(DeviceFault if self.unit is None else UnitFault)
        if self.kind not in allowed:
            what = "a device" if self.unit is None else "a unit"
            raise telling(f"{self.kind_key} is '{self.kind}', {what} can be {', '.join(allowed)}")
        return self

    @property
    def victim(self) -> str:
        """Return the device or the unit as text."""
        return self.device or f"unit {self.unit}"


class Simulation(StrictModel):
    """Simulation data that no certificate states; errors within certificates are drawn from them with sd = U / k."""

    seed: Annotated[WholeNumber, Field(ge=0, lt=2**63)] = Field(1, description="the same one gives the same run")
    start: Instant = Field(
        dt.datetime.fromisoformat("2026-01-01T00:00:00+00:00"), description="when simulated runs begin"
    )
    units: Mapping[Name, Annotated[Path, FileBeside()]] = Field({}, description="the truth of the unit in each place")
    ambient: Celsius = Field(22.0, description="temperature of the room")
    chamber: ChamberSimulation = ChamberSimulation()
    head: HeadSimulation = HeadSimulation()
    table: TableSimulation | None = None
    thermometer: ThermometerSimulation = ThermometerSimulation()
    remount: Arcseconds = Field(
        0.0,
        description="standard deviation of the mounting angle each time a unit is fixed by hand",
    )
    voltmeters: Mapping[Name, VoltmeterSimulation] = Field({}, description="connection of each voltmeter")
    sources: Mapping[Name, SourceSimulation] = Field({}, description="errors of each current source")
    ammeters: Mapping[Name, AmmeterSimulation] = Field({}, description="noise of each ammeter")
    host_clock: Annotated[Ratio, InUnit("", at_least=0)] = Field(
        20e-6, description="standard deviation of the host clock against the true second"
    )
    faults: tuple[FaultSimulation, ...] = ()
