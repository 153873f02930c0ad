"""Description of the driver of a pulse counter on CAN."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.can.options import FRAME_SCHEMES, IDLE_BLOCK_S, ClockUncertainty, bus_load, readings
from drivers.can.sent_frames import BusLoad, Counted, Encoder, Output, SentFrames
from drivers.certificates.corrections import ClockCorrections
from drivers.description import DriverDescription
from drivers.dialects.can_counter.options import CounterOptions
from drivers.safe_state import NOTHING


def _outputs(options: CounterOptions) -> Mapping[str, Output]:
    channel = Counted(options.period, options.latch.tick_period, options.max_rate)
    return dict.fromkeys(options.channels, channel)


def _encoders(options: CounterOptions) -> Mapping[str, Encoder]:
    return {
        device: Encoder(each.resolution, options.period, options.latch.tick_period)
        for device, each in options.positions.items()
    }


def _bus_load(options: CounterOptions) -> BusLoad:
    signals = [options.latch.tick, options.latch.sequence]
    signals += [name for channel in options.channels.values() for _, name in channel]
    signals += [name for each in options.positions.values() for name in (each.position, each.sequence)]
    return bus_load(options.dbc, dict.fromkeys(signals, options.period), options.positions)


DESCRIPTION = DriverDescription(
    name="can_counter",
    title="pulse counters over CAN, described by a DBC",
    capabilities=frozenset({"pulse_counter"}),
    schemes=FRAME_SCHEMES,
    target="drivers.dialects.can_counter.driver:CanCounter",
    simulator="simulators.instruments.can_nodes.can_counter:SimulatedCounter",
    options=CounterOptions,
    safe_state=NOTHING,
    uncertainty=ClockUncertainty,
    corrections=ClockCorrections,
    reports_every_s=IDLE_BLOCK_S,
    channels=readings,
    frames=SentFrames(
        outputs=_outputs,
        encoders=_encoders,
        bus_load=_bus_load,
        decoder="drivers.dialects.can_counter.decoder:CounterDecoder",
    ),
)
