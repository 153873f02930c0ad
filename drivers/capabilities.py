"""What a device can do for a sequence. A role in a bench file is filled by a driver that has the capability.

Every device is an async context manager: inside it, it is connected *and* identified. `make_safe` may be called at
any time and in any state, twice too, and ends in bounded time. Commands that move or energise are sent once: after a
timeout the driver reads back and decides, it never repeats them blindly.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from typing import TYPE_CHECKING, Protocol, Self, runtime_checkable

from drivers.values import Approach as Approach

if TYPE_CHECKING:  # checking a sequence needs the names here, and not numpy
    from drivers.can.frame_block import FrameBlock
    from drivers.values import ChamberState, Heard, Identity, Reading, SourceReading


@runtime_checkable
class Device(Protocol):
    """An opened instrument."""

    name: str

    async def __aenter__(self) -> Self:
        """Connects and identifies; raises CannotConnect or WrongIdentity."""

    async def __aexit__(self, *exc: object) -> None:
        """Closes the wire; does not change what the instrument does."""

    async def identify(self) -> Identity:
        """Asks who is there; raises WrongIdentity when it is not the instrument of the bench file."""

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        """The readings by channel that are new since the last poll; changes nothing in the instrument.

        Raises InstrumentFault if the state differs from the commanded one, NoAnswer if it is silent.
        """

    async def make_safe(self) -> None:
        """Brings the instrument into its safe state; idempotent, legal in any state, bounded in time."""


@runtime_checkable
class Positioner(Device, Protocol):
    """An axis that goes to angles."""

    async def move_to(self, angle_deg: float, *, approach: Approach, settle_s: float) -> Reading:
        """Move to `angle_deg`, wait until it has settled, then `settle_s`; return the angle read back (°)."""

    async def angle(self) -> Reading:
        """The angle now (°)."""

    async def stop(self) -> None:
        """Decelerates and holds."""


@runtime_checkable
class RateTable(Device, Protocol):
    """An axis that turns without end, and swings."""

    async def rotate_at(self, rate_dps: float, *, acceleration_dps2: float | None) -> None:
        """Turns at `rate_dps`, returning when it is reached and read back; positive turns count the angle up.

        `acceleration_dps2` is how fast the rate changes; None leaves that to the bench file.
        """

    async def oscillate(self, amplitude_deg: float, frequency_hz: float) -> None:
        """Swings as a sine by ± `amplitude_deg` about the angle where it stands; returns when it does so fully."""

    async def stop(self) -> None:
        """Zero rate; returns when the axis is at rest."""

    async def rate(self) -> Reading:
        """The rate now (°/s)."""

    async def angle(self) -> Reading:
        """The angle now (°), whole turns included as far as the instrument reports them."""


@runtime_checkable
class ThermalChamber(Device, Protocol):
    """A chamber that ramps by itself."""

    async def ramp_to(self, temperature_c: float, rate_c_per_min: float) -> None:
        """Returns when the set point in force has arrived; the air and the unit are still on their way."""

    async def state(self) -> ChamberState:
        """State of the control loop."""

    async def hold(self) -> None:
        """Stops a ramp where it is: the set point in force becomes the set point."""


@runtime_checkable
class Source(Device, Protocol):
    """A supply (volts) or a current source (amperes)."""

    async def set(self, level: float, *, limit: float, output: bool) -> None:
        """Sets the level (V, or A for a current source), its limit (A, or V compliance), then the output.

        Switching off needs no level: the output goes off first.
        """

    async def read(self) -> SourceReading:
        """What the output does now."""


@runtime_checkable
class FrameSource(Device, Protocol):
    """What sends frames by itself."""

    def acquire(self, *, block_s: float | None = None) -> AbstractAsyncContextManager[AsyncIterator[FrameBlock]]:
        """Blocks of frames from entry to exit: the first frame arrived after entry, the last before exit.

        A block comes every `block_s` or more often; without it, as often as what is recorded must be on the disk.
        """

    async def news(self) -> None:
        """Return when frames have been taken in since the last call, or a fault is known, which `poll` raises.

        That is at the latest as often as a reading may be on its way (`reports_every_s`), and after every `take_in`.
        """

    def take_in(self) -> None:
        """Takes in what has arrived by now."""

    def heard(self) -> Mapping[str, Heard]:
        """Time of the last frame of each channel, as far as frames have been taken in."""


@runtime_checkable
class PulseCounter(FrameSource, Protocol):
    """Counters that run freely."""


@runtime_checkable
class Telemetry(FrameSource, Protocol):
    """Units under test that send samples of their own output; without power they send nothing."""


@runtime_checkable
class Meter(Device, Protocol):
    """An instrument that measures when it is asked to."""

    async def measure(self, count: int, *, nplc: float | None) -> Sequence[Reading]:
        """`count` readings (V, or A of an ammeter), one after the other, each with the time of its middle.

        `nplc` is over how many cycles of the power line each integrates; None leaves that to the bench file.
        """


@runtime_checkable
class Voltmeter(Meter, Protocol):
    """A meter of DC volts."""


@runtime_checkable
class Ammeter(Meter, Protocol):
    """A meter of DC current, in series with what drives it."""


CAPABILITIES: Mapping[str, type] = {
    "positioner": Positioner,
    "rate_table": RateTable,
    "thermal_chamber": ThermalChamber,
    "power_supply": Source,
    "current_source": Source,
    "pulse_counter": PulseCounter,
    "voltmeter": Voltmeter,
    "ammeter": Ammeter,
    "telemetry": Telemetry,
}
THERMOMETER = "thermometer"  # a named reading of any device, in °C
READING = "reading"  # a named reading of any device, in any unit
OUTPUT = "output"  # of the units: pulse counters, voltmeters or telemetry, as the places of the bench say
MEASURES_OUTPUTS = ("pulse_counter", "voltmeter", "telemetry", OUTPUT)  # what a role is that outputs come from
