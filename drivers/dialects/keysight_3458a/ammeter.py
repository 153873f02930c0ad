"""Bench file keys of a Keysight 3458A that measures a current."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.certificates.corrections import CurrentCorrections
from drivers.certificates.current_standard import CurrentUncertainty
from drivers.description import DriverDescription
from drivers.dialects.keysight_3458a.description import MeterOptions
from drivers.dialects.keysight_3458a.wire import RANGES_A
from drivers.kinds.ranges import range_of
from drivers.safe_state import NOTHING
from drivers.schema.fields import InUnit

BURDEN_V = dict(zip(RANGES_A, (0.055, 0.045, 0.055, 0.075, 0.1, 0.1, 0.25, 1.5), strict=True))
KNOWN_RANGE = range_of(RANGES_A, "A", "100 nA, 1 µA, 10 µA, 100 µA, 1 mA, 10 mA, 100 mA or 1 A")


class AmmeterOptions(MeterOptions):
    """Measurement of DC current, in series with a source; auto-zero is always on.

    It is connected like the voltmeter `keysight_3458a`, through a gateway between TCP and GPIB.
    """

    range: Annotated[float, InUnit("A", above=0), KNOWN_RANGE] = Field(
        description="the one range for all readings, 100 nA to 1 A in decades; it measures 20 % beyond its name, "
        "and 5 % beyond 1 A"
    )

    @property
    def burden_ohm(self) -> float:
        """Maximum input resistance: the burden voltage of the maker's data sheet over the range."""
        return BURDEN_V[self.range] / self.range


DESCRIPTION = DriverDescription(
    name="keysight_3458a_ammeter",
    title="ammeter Keysight (HP, Agilent) 3458A, in series with a current source, over a TCP gateway to GPIB",
    capabilities=frozenset({"ammeter"}),
    schemes=frozenset({"tcp"}),
    target="drivers.dialects.keysight_3458a.driver:Keysight3458AAmmeter",
    options=AmmeterOptions,
    safe_state=NOTHING,
    uncertainty=CurrentUncertainty,
    corrections=CurrentCorrections,
    channels={"current": "A"},
)
