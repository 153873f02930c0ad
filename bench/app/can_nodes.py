"""What simulated counters and units that send over CAN put on their bus: from the bench file and its DBC files."""

from __future__ import annotations

from collections.abc import Mapping

from bench.config.models import BenchFile
from bench.errors import InputError
from drivers.can.dbc import Dbc
from drivers.can.options import text_of
from drivers.certificates.corrections import ARCSEC_PER_DEG
from drivers.dialects.can_counter.binding import format_of
from drivers.dialects.can_counter.description import CounterOptions
from drivers.dialects.can_telemetry.binding import encoders_of, formats_of
from drivers.dialects.can_telemetry.description import TelemetryOptions
from simulators.instruments.can_nodes.can_counter import CounterSettings
from simulators.instruments.can_nodes.can_telemetry import ChannelSettings, EncoderSettings, TelemetrySettings
from simulators.units.accelerometer import Decoding
from simulators.units.gyro_file import GyroFile
from simulators.units.imu import CHANNELS, SENSORS
from simulators.units.imu_file import ImuFile
from simulators.units.unit_file import UnitFile


def counter_settings(bench: BenchFile, role: str, options: CounterOptions) -> CounterSettings:
    """What a counter latches, which readings of which units it sends along, and whose encoders it latches."""
    dbc = Dbc(text_of(options.dbc))
    readings, imu_readings = _thermometers(bench, role)
    boards = {
        bench.readings[place.converter_temperature].channel: name
        for name, place in bench.places.items()
        if place.converter_temperature and bench.readings[place.converter_temperature].device == role
    }
    encoders = {name: ARCSEC_PER_DEG / encoder.resolution for name, encoder in options.positions.items()}
    return CounterSettings(role, dbc, format_of(options, dbc), options.period, readings, boards, imu_readings, encoders)


def _thermometers(bench: BenchFile, role: str) -> tuple[dict[str, str], dict[str, tuple[str, str]]]:
    """Of which place a node sends a temperature, by its signal; of an inertial unit also of which sensors."""
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
    return readings, imu_readings


def decoding_of(bench: BenchFile, channel: str | None) -> Decoding | None:
    """What becomes of the codes on a channel of telemetry; None where no telemetry has it."""
    for device in bench.devices.values():
        if isinstance(device.options, TelemetryOptions) and channel in device.options.channels:
            form = formats_of(device.options, Dbc(text_of(device.options.dbc)))[channel]
            return Decoding(form.value.signal.scale, form.value.signal.offset) if form.decoded else Decoding()
    return None


def telemetry_settings(
    bench: BenchFile, role: str, options: TelemetryOptions, units: Mapping[str, object], encoder_skew_s: float = 0.0
) -> TelemetrySettings:
    """The channels of a telemetry that have a unit; InputError if the unit's file has no `telemetry`."""
    dbc = Dbc(text_of(options.dbc))
    forms = formats_of(options, dbc)
    places = {
        channel: name
        for name, entry in bench.places.items()
        for key, channel in entry.measured_by.items()
        if channel in forms and (key == "telemetry" or entry.channels is not None)
    }
    for channel, name in places.items():
        _check_sends(bench, name, units[name])
        if options.channels[channel].sample != "mean":
            raise InputError(f"the simulated unit of place '{name}' sends means; write sample: mean for its channel")
    for message in {form.value.message.name for form in forms.values()}:
        alike = {
            (places[channel], options.channels[channel].period)
            for channel in places
            if forms[channel].value.message.name == message
        }
        if len(alike) > 1:
            raise InputError(
                f"'{role}' has channels of several units, or with several periods, in {message}; no "
                "simulator supports this"
            )
    encoders = {
        name: EncoderSettings(form, ARCSEC_PER_DEG / options.positions[name].resolution)
        for name, form in encoders_of(options, dbc).items()
    }
    readings, imu_readings = _thermometers(bench, role)
    return TelemetrySettings(
        name=role,
        dbc=dbc,
        channels={
            channel: ChannelSettings(
                forms[channel],
                sample.period,
                sample.tick_period,
                places[channel],
                {name: each for name, each in encoders.items() if options.positions[name].channel == channel},
                encoder_skew_s,
            )
            for channel, sample in options.channels.items()
            if channel in places
        },
        readings=readings,
        imu_readings=imu_readings,
    )


def _check_sends(bench: BenchFile, place: str, unit: object) -> None:
    """InputError if the file of a unit has no `telemetry`, or only some of its channels are used."""
    if not isinstance(unit, UnitFile | GyroFile | ImuFile) or unit.telemetry is None:
        raise InputError(f"the simulated unit of place '{place}' sends no codes: its file needs 'telemetry'")
    if isinstance(unit, ImuFile) and len(bench.sent_units(bench.places[place])) < len(CHANNELS):
        raise InputError(f"the simulated unit of place '{place}' sends all of its channels; declare all of them")
