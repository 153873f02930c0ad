"""What a bench file says of a pulse counter on CAN."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from pydantic import Field

from drivers.dbc_outline import outline
from drivers.description import DriverDescription
from drivers.fields import FileBeside, Hertz, InUnit, PositiveSeconds, Ratio, StrictModel

IDLE_BLOCK_S = 10.0  # how long frames are left together while nobody acquires

SignalName = Annotated[str, Field(pattern=r"^\w+\.\w+$")]


class LatchOptions(StrictModel):
    """The frame that says when the counters were latched."""

    tick: SignalName
    tick_period: PositiveSeconds
    sequence: SignalName
    boot_count: SignalName | None = None


class ChannelOptions(StrictModel):
    """The signals of one pair of counters; `sequence` tells the latch they belong to."""

    positive: SignalName
    negative: SignalName
    sequence: SignalName


class CounterOptions(StrictModel):
    """Where in the frames the counters are; names are Message.Signal of the DBC."""

    dbc: Annotated[Path, FileBeside()]
    period: PositiveSeconds
    max_rate: Hertz
    latch: LatchOptions
    channels: Annotated[dict[str, ChannelOptions], Field(min_length=1)]


class CounterUncertainty(StrictModel):
    """What a certificate states of the counter, expanded."""

    time_base: Annotated[Ratio, InUnit("", at_least=0)] = 0.0


def channels(options: CounterOptions) -> Mapping[str, str]:
    """Every signal of the DBC with a unit of temperature is a reading."""
    signals = outline(options.dbc.read_text(encoding="utf-8", errors="replace"))
    return {name: unit for name, unit in signals.items() if unit == "°C"}


DESCRIPTION = DriverDescription(
    name="can_counter",
    title="pulse counters over CAN, described by a DBC",
    capabilities=frozenset({"pulse_counter"}),
    schemes=frozenset({"slcan", "can"}),
    target="drivers.can_counter.driver:CanCounter",
    options=CounterOptions,
    uncertainty=CounterUncertainty,
    reports_every_s=IDLE_BLOCK_S,
    channels=channels,
)
