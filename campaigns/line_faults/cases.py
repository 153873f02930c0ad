"""The lines that are tried: every instrument that is read over one, on each of its kinds of line."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

from bench.config.devices import DeviceEntry
from tests.support.instruments import Instrument, OnLine, tried


class Link(StrEnum):
    """Protection of a link against altered bytes."""

    CHECKSUM = "a checksum of its own"
    TCP = "TCP"  # between its two ends; what an instrument garbles before it sends it is beyond that
    NOTHING = "nothing"  # what enters a result is then asked twice


@dataclass(frozen=True)
class Case:
    """One instrument on one line."""

    driver: str
    instrument: Instrument
    line: OnLine

    @cached_property
    def entry(self) -> DeviceEntry:
        """The instrument in a bench file, at the address of the line."""
        return self.instrument.entry(self.driver, self.line.connection)

    @cached_property
    def link(self) -> Link:
        """Protection of its answers."""
        if self.line.checked:
            return Link.CHECKSUM
        return Link.NOTHING if self.entry.connection.is_serial_line else Link.TCP


CASES = {
    f"{driver}, {line.label}" if line.label else driver: Case(driver, instrument, line)
    for driver, instrument in tried("bad lines").items()
    for line in instrument.lines
}
