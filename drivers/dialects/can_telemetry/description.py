"""Description of the driver of the telemetry of units under test on CAN."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.can.options import FRAME_SCHEMES, IDLE_BLOCK_S, ClockUncertainty, bus_load, readings
from drivers.can.sent_frames import BusLoad, Encoder, Output, SentFrames
from drivers.description import DriverDescription
from drivers.dialects.can_telemetry.options import TelemetryOptions
from drivers.safe_state import NOTHING


def _outputs(options: TelemetryOptions) -> Mapping[str, Output]:
    return {name: sample.output for name, sample in options.channels.items()}


def _encoders(options: TelemetryOptions) -> Mapping[str, Encoder]:
    found = {}
    for device, each in options.positions.items():
        sample = options.channels[each.channel]
        found[device] = Encoder(each.resolution, sample.period, sample.tick_period, each.channel)
    return found


def _bus_load(options: TelemetryOptions) -> BusLoad:
    periods_s = {sample.value: sample.period for sample in options.channels.values()}
    for encoder in options.positions.values():
        periods_s |= dict.fromkeys((encoder.position, encoder.sequence), options.channels[encoder.channel].period)
    return bus_load(options.dbc, periods_s, options.positions)


DESCRIPTION = DriverDescription(
    name="can_telemetry",
    title="units that send samples of their output over CAN, described by a DBC",
    capabilities=frozenset({"telemetry"}),
    schemes=FRAME_SCHEMES,
    target="drivers.dialects.can_telemetry.driver:CanTelemetry",
    simulator="simulators.instruments.can_nodes.can_telemetry:SimulatedTelemetry",
    options=TelemetryOptions,
    safe_state=NOTHING,
    uncertainty=ClockUncertainty,
    reports_every_s=IDLE_BLOCK_S,
    channels=readings,
    frames=SentFrames(
        outputs=_outputs,
        encoders=_encoders,
        bus_load=_bus_load,
        decoder="drivers.dialects.can_telemetry.decoder:TelemetryDecoder",
    ),
)
