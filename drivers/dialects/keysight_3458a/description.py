"""Bench file keys of a Keysight 3458A."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from drivers.certificates.corrections import VoltageCorrections
from drivers.description import DriverDescription
from drivers.dialects.keysight_3458a.wire import NPLCS, RANGES_V
from drivers.kinds.ranges import range_of
from drivers.safe_state import NOTHING
from drivers.schema.fields import InUnit, Number, Ratio, StrictModel
from drivers.schema.wording import telling

KNOWN_RANGE = range_of(RANGES_V, "V", "100 mV, 1 V, 10 V, 100 V or 1000 V")


def _known_nplc(nplc: float) -> float:
    if nplc not in NPLCS:
        raise telling(f"is {nplc:g}, expected a whole number from 1 to 10, or 20 to 100 in tens")
    return nplc


class MeterOptions(StrictModel):
    """Options common to voltage and current measurement."""

    range: float = Field(description="the one range for all readings")
    nplc: Annotated[Number, AfterValidator(_known_nplc)] = Field(
        10.0, description="integration time of a reading in power line cycles: 1 to 10, or 20 to 100 in tens"
    )


class VoltmeterOptions(MeterOptions):
    """Measurement of DC voltage; auto-zero is always on.

    The instrument has GPIB only: the address is that of a gateway between TCP and GPIB that passes lines on as they are
    and reads an answer after each (on a Prologix, once: `++mode 1`, `++addr 22`, `++auto 1`, `++eoi 1`, `++eos 2`,
    `++savecfg 1`). A reading takes twice `nplc` cycles of the power line, and must not take longer than the gateway
    waits for it.
    """

    range: Annotated[float, InUnit("V", above=0), KNOWN_RANGE] = Field(
        description="the one range for all readings, 100 mV to 1000 V in decades; it measures 20 % beyond its name"
    )


class VoltmeterUncertainty(StrictModel):
    """Expanded uncertainty of the voltmeter in its range, from its certificate."""

    gain: Annotated[Ratio, InUnit("", at_least=0)] = Field(0.0, description="relative to the reading, such as 8 ppm")
    offset: Annotated[float, InUnit("V", at_least=0)] = Field(0.0, description="constant part")


DESCRIPTION = DriverDescription(
    name="keysight_3458a",
    title="voltmeter Keysight (HP, Agilent) 3458A, over a TCP gateway to GPIB",
    capabilities=frozenset({"voltmeter"}),
    schemes=frozenset({"tcp"}),
    target="drivers.dialects.keysight_3458a.driver:Keysight3458A",
    recognition="drivers.dialects.keysight_3458a.recognition:RECOGNITION",
    options=VoltmeterOptions,
    safe_state=NOTHING,
    uncertainty=VoltmeterUncertainty,
    corrections=VoltageCorrections,
    channels={"voltage": "V"},
)
