"""What simulated counters and units that send over CAN put on their bus: from the bench file and its DBC files."""

from __future__ import annotations

from collections.abc import Mapping

from bench.config.models import BenchFile
from bench.config.places import PlaceEntry
from bench.errors import InputError
from drivers.can_counter.binding import format_of
from drivers.can_counter.description import CounterOptions
from drivers.can_options import text_of
from drivers.can_telemetry.binding import formats_of
from drivers.can_telemetry.description import TelemetryOptions
from drivers.corrections import ARCSEC_PER_DEG
from drivers.dbc import Dbc
from simulators.can_counter import CounterSettings
from simulators.can_telemetry import ChannelSettings, TelemetrySettings
from simulators.imu import SENSORS
from simulators.unit_file import UnitFile
from simulators.uut import Decoding


def counter_settings(bench: BenchFile, role: str, options: CounterOptions) -> CounterSettings:
    """What a counter latches, which readings of which units it sends along, and whose encoders it latches."""
    dbc = Dbc(text_of(options.dbc))
    readings: dict[str, str] = {}
    imu_readings: dict[str, tuple[str, str]] = {}
    for name, place in bench.places.items():
        at = (place.temperature, place.gyro_temperature or place.temperature)
        shown = [bench.readings[each] for each in at]
        if place.channels is None and shown[0].device == role:
            readings[shown[0].channel] = name
        elif place.channels is not None:
            imu_readings |= {
                each.channel: (name, sensor) for each, sensor in zip(shown, SENSORS, strict=True) if each.device == role
            }
    boards = {
        bench.readings[place.converter_temperature].channel: name
        for name, place in bench.places.items()
        if place.converter_temperature and bench.readings[place.converter_temperature].device == role
    }
    encoders = {name: ARCSEC_PER_DEG / encoder.resolution for name, encoder in options.positions.items()}
    return CounterSettings(role, dbc, format_of(options, dbc), options.period, readings, boards, imu_readings, encoders)


def decoding_of(bench: BenchFile, entry: PlaceEntry) -> Decoding | None:
    """What becomes of the codes of a unit that sends its output; None of any other."""
    for device in bench.devices.values():
        if isinstance(device.options, TelemetryOptions) and entry.telemetry in device.options.channels:
            form = formats_of(device.options, Dbc(text_of(device.options.dbc)))[entry.telemetry]
            return Decoding(form.value.signal.scale, form.value.signal.offset) if form.decoded else Decoding()
    return None


def telemetry_settings(
    bench: BenchFile, role: str, options: TelemetryOptions, units: Mapping[str, object]
) -> TelemetrySettings:
    """The channels of a telemetry that have a unit; InputError when its truth says nothing of codes."""
    dbc = Dbc(text_of(options.dbc))
    forms = formats_of(options, dbc)
    places = {entry.telemetry: name for name, entry in bench.places.items() if entry.telemetry in forms}
    for name in places.values():
        unit = units[name]
        if not isinstance(unit, UnitFile) or unit.telemetry is None:
            raise InputError(f"the simulated unit of place '{name}' sends no codes: its file needs 'telemetry'")
    messages = [forms[channel].value.message.name for channel in places]
    if len(set(messages)) < len(messages):
        raise InputError(f"'{role}' has several channels in one message, which simulated units do not send")
    return TelemetrySettings(
        name=role,
        dbc=dbc,
        channels={
            channel: ChannelSettings(forms[channel], sample.period, sample.tick_period, places[channel])
            for channel, sample in options.channels.items()
            if channel in places
        },
        readings={
            bench.readings[entry.temperature].channel: name
            for name, entry in bench.places.items()
            if bench.readings[entry.temperature].device == role
        },
    )
