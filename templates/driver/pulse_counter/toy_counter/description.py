"""Bench file keys of the counter, and the description of its frames."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from drivers.can.options import FRAME_SCHEMES, IDLE_BLOCK_S, ClockUncertainty
from drivers.can.sent_frames import BusLoad, Counted, SentFrames
from drivers.certificates.corrections import ClockCorrections
from drivers.description import DriverDescription
from drivers.safe_state import NOTHING
from drivers.schema.fields import NOT_EMPTY, Hertz, PositiveSeconds, StrictModel, WholeNumber
from pydantic import Field

TEMPERATURE = "temperature"
TICK_S = 1e-3
BITS_OF_A_FRAME = 135  # maximum length on the bus of a frame with eight bytes, with stuff bits


class ToyCounterOptions(StrictModel):
    """Setup of the counter."""

    period: PositiveSeconds = Field(description="period of the latches")
    max_rate: Hertz = Field(description="maximum pulse rate; bounds the gap over which a count stays unambiguous")
    inputs: Annotated[dict[str, Annotated[WholeNumber, Field(ge=0, le=15)]], NOT_EMPTY] = Field(
        description="input number of each channel"
    )


def _outputs(options: ToyCounterOptions) -> Mapping[str, Counted]:
    return dict.fromkeys(options.inputs, Counted(options.period, TICK_S, options.max_rate))


def _bus_load(options: ToyCounterOptions) -> BusLoad:
    return BusLoad(bits_per_s=BITS_OF_A_FRAME * len(options.inputs) / options.period)


DESCRIPTION = DriverDescription(
    name="toy_counter",
    title="fictitious pulse counter",
    capabilities=frozenset({"pulse_counter"}),
    schemes=FRAME_SCHEMES,
    target="toy_counter.driver:ToyCounter",
    simulator="toy_counter.simulator:SimulatedToyCounter",
    options=ToyCounterOptions,
    safe_state=NOTHING,
    uncertainty=ClockUncertainty,
    corrections=ClockCorrections,
    reports_every_s=IDLE_BLOCK_S,
    channels={TEMPERATURE: "°C"},
    frames=SentFrames(outputs=_outputs, bus_load=_bus_load, decoder="toy_counter.decoder:ToyCounterDecoder"),
)
