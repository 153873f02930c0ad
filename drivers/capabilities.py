"""Capabilities of devices. A role of a sequence is filled by a device whose driver has the capability.

Every device is an async context manager: inside it, it is connected *and* identified. `make_safe` may be called at
any time and in any state, twice too, and ends in bounded time. Commands that move or energise are sent once: after a
timeout the driver reads back and decides, it never repeats them blindly.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from typing import TYPE_CHECKING, Protocol, Self, runtime_checkable

from drivers.values import Approach as Approach

if TYPE_CHECKING:  # the check of a sequence needs the names here, and not numpy
    from drivers.can.frame_block import FrameBlock
    from drivers.values import ChamberState, Identity, LastSeen, Reading, SourceReading


@runtime_checkable
class Device(Protocol):
    """An opened instrument."""

    name: str

    async def __aenter__(self) -> Self:
        """Connect and identify; raises CannotConnect or WrongIdentity."""

    async def __aexit__(self, *exc: object) -> None:
        """Close the connection; the instrument keeps its state."""

    async def identify(self) -> Identity:
        """Query the identity; raises WrongIdentity if it is not the instrument of the bench file."""

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        """New readings since the last poll, by channel; changes nothing in the instrument.

        Raises InstrumentFault if the state differs from the commanded one, NoAnswer if it is silent.
        """

    async def make_safe(self) -> None:
        """Bring the instrument into its safe state; idempotent, legal in any state, bounded in time."""


@runtime_checkable
class Positioner(Device, Protocol):
    """An axis that moves to angles."""

    async def move_to(self, angle_deg: float, *, approach: Approach, settle_s: float) -> Reading:
        """Move to `angle_deg`, wait until it has settled, then `settle_s`; return the angle read back (°)."""

    async def angle(self) -> Reading:
        """The angle now (°)."""

    async def stop(self) -> None:
        """Decelerate and hold."""


@runtime_checkable
class RateTable(Device, Protocol):
    """An axis that rotates continuously and oscillates."""

    async def rotate_at(self, rate_dps: float, *, acceleration_dps2: float | None) -> None:
        """Turn at `rate_dps`; return when that rate is reached and read back. Positive rates increase the angle.

        `acceleration_dps2` is the rate of change; None takes that of the bench file.
        """

    async def oscillate(self, amplitude_deg: float, frequency_hz: float) -> None:
        """Oscillate sinusoidally by ± `amplitude_deg` about the present angle; return at full amplitude."""

    async def stop(self) -> None:
        """Decelerate to zero rate; return when the axis is at rest."""

    async def rate(self) -> Reading:
        """The rate now (°/s)."""

    async def angle(self) -> Reading:
        """Angle (°), including whole turns as far as the instrument reports them."""


@runtime_checkable
class SweepingTable(RateTable, Protocol):
    """A rate table that can change the frequency of an oscillation continuously."""

    async def sweep(self, to_hz: float, over_s: float) -> None:
        """Change the frequency of the present oscillation at a constant rate within `over_s`; return at its begin."""


@runtime_checkable
class ThermalChamber(Device, Protocol):
    """A chamber with programmable temperature ramps."""

    async def ramp_to(self, temperature_c: float, rate_c_per_min: float) -> None:
        """Ramp the set point; return when the active set point has arrived. Air and unit follow later."""

    async def state(self) -> ChamberState:
        """State of the control loop."""

    async def hold(self) -> None:
        """Stop a ramp: the active set point becomes the set point."""


@runtime_checkable
class Source(Device, Protocol):
    """A supply (volts) or a current source (amperes)."""

    async def set(self, level: float, *, limit: float, output: bool) -> None:
        """Set level (V, or A of a current source) and limit (A, or compliance in V), then the output.

        Switching off needs no level: the output goes off first.
        """

    async def read(self) -> SourceReading:
        """Read level and output state."""


@runtime_checkable
class FrameSource(Device, Protocol):
    """A device that sends frames unsolicited."""

    def acquire(self, *, block_s: float | None = None) -> AbstractAsyncContextManager[AsyncIterator[FrameBlock]]:
        """Context manager whose value yields blocks of the frames that arrive between entry and exit.

        Blocks have at most `block_s`; None takes the interval at which records must be on disk.
        """

    async def wait_for_data(self) -> None:
        """Return when frames arrived since the last call, or when there is a fault, which `poll` then raises.

        Returns at least every `reports_every_s`, and after every `drain`.
        """

    def drain(self) -> None:
        """Process the frames that have arrived."""

    def last_seen(self) -> Mapping[str, LastSeen]:
        """Time of the last frame of each channel, as far as frames have been processed."""


@runtime_checkable
class PulseCounter(FrameSource, Protocol):
    """Free-running pulse counters."""


@runtime_checkable
class Telemetry(FrameSource, Protocol):
    """Telemetry: samples sent by the units under test themselves; without power they send nothing."""


@runtime_checkable
class Meter(Device, Protocol):
    """An instrument that measures on request."""

    async def measure(self, count: int, *, nplc: float | None) -> Sequence[Reading]:
        """Take `count` consecutive readings (V, or A of an ammeter), each with its mid-integration time.

        `nplc` is the integration time of each in power line cycles; None takes that of the bench file.
        """


@runtime_checkable
class Voltmeter(Meter, Protocol):
    """A meter of DC volts."""


@runtime_checkable
class Ammeter(Meter, Protocol):
    """A meter of DC current, in series with the source."""


THERMOMETER = "thermometer"  # a named reading of any device, in °C
READING = "reading"  # a named reading of any device, in any unit
OUTPUT = "output"  # of the units: pulse counters, voltmeters or telemetry, as given by the places of the bench
MEASURES_OUTPUTS = ("pulse_counter", "voltmeter", "telemetry", OUTPUT)  # capabilities of roles with outputs of units
