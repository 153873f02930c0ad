"""Bench file keys of a Fluke 5700A, 5720A or 5730A that is used as a current source."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.dialects.fluke_5700a.wire import RANGES_A, Terminator
from drivers.kinds.described import current_source
from drivers.kinds.ranges import range_of
from drivers.safe_state import DIALOGUE_S, SafeState
from drivers.schema.fields import InUnit, PositiveSeconds, StrictModel

KNOWN_RANGE = range_of(RANGES_A, "A", "220 µA, 2.2 mA, 22 mA, 220 mA or 2.2 A")


class FlukeOptions(StrictModel):
    """Use of the calibrator as DC current source at its own terminals, in one locked range.

    Its remote interface must be set to COMPUTER (as delivered it is TERMINAL, which is for people). `terminator` and
    the baud rate of the connection must be those of its RS-232 menu; where that says XON, the connection ends with
    `&flow=xonxoff`. Guard and terminals stay as they are set at its front panel; boost, offset and scale must be off.

    The reading `settled` is 1 while it operates within its specification, else 0. `on_time` proves a warm-up: it is for
    how long the power is known to be on, at least, since the bench connected or the power came back. A calibrator
    itself counts only the minutes of its whole life.
    """

    range: Annotated[float, InUnit("A", above=0), KNOWN_RANGE] = Field(
        description="the one range for all levels: 220 µA, 2.2 mA, 22 mA, 220 mA or 2.2 A"
    )
    compliance: Annotated[float, InUnit("V", above=0)] = Field(
        description="its maximum compliance from the data sheet; it cannot be set, so a sequence must request "
        "exactly this value"
    )
    settle_within: PositiveSeconds = Field(
        15.0, description="time after a setting at which an unsettled output is an error"
    )
    terminator: Terminator = "crlf"


DESCRIPTION = current_source(
    name="fluke_5700a",
    title="calibrator Fluke 5700A, 5720A or 5730A as a precision current source",
    schemes=frozenset({"serial", "socket", "tcp"}),
    target="drivers.dialects.fluke_5700a.driver:Fluke5700A",
    simulator="simulators.instruments.sources.fluke_5700a:SimulatedFluke",
    recognition="drivers.dialects.fluke_5700a.recognition:RECOGNITION",
    options=FlukeOptions,
    safe_state=SafeState("0 A, then standby", DIALOGUE_S),
    channels={"current": "A", "settled": "", "on_time": "s"},
)
