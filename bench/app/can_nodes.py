"""Channels of simulated devices that send frames, from the bench file."""

from __future__ import annotations

from collections.abc import Mapping

from bench.config.models import BenchFile
from bench.config.places import PlaceEntry
from bench.errors import InputError
from bench.store.decoder import Decoder
from drivers.can.sent_frames import Sampled
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.can_nodes.can_node import NodeSetup
from simulators.units.accelerometer import Decoding
from simulators.units.gyro_file import GyroFile
from simulators.units.imu_file import ImuFile
from simulators.units.imu_temperatures import CHANNELS, CIRCUIT, SENSORS
from simulators.units.unit_file import UnitFile
from simulators.world import World


def node_setup(
    bench: BenchFile,
    role: str,
    world: World,
    faults: FaultPlan,
    units: Mapping[str, object],
    encoder_skew_s: float,
) -> NodeSetup:
    """Return the outputs, thermometers and encoders of a device.

    Raises InputError if a unit lacks a required output.
    """
    readings, imu_readings = _thermometers(bench, role)
    return NodeSetup(
        role=role,
        world=world,
        faults=faults,
        options=bench.devices[role].options,
        places=_places(bench, role, units),
        readings=readings,
        boards={
            bench.readings[place.converter_temperature].channel: name
            for name, place in bench.places.items()
            if place.converter_temperature and bench.readings[place.converter_temperature].device == role
        },
        imu_readings=imu_readings,
        encoder_skew_s=encoder_skew_s,
    )


def _places(bench: BenchFile, role: str, units: Mapping[str, object]) -> dict[str, str]:
    """Return the place of the unit on each channel of a device. Raises InputError."""
    outputs, found = bench.devices[role].outputs, {}
    for name, entry in bench.places.items():
        for key, channel in entry.measured_by.items():
            output = outputs.get(channel)
            wanted = "telemetry" if isinstance(output, Sampled) else "channel"
            if output is None or (entry.channels is None and key != wanted):
                continue
            found[channel] = name
            if isinstance(output, Sampled):
                _check_sends(bench, name, units[name])
                if not output.averaged:
                    raise InputError(
                        f"the simulated unit of place '{name}' sends means; write sample: mean for its channel"
                    )
    return found


def _thermometers(bench: BenchFile, role: str) -> tuple[dict[str, str], dict[str, tuple[str, str]]]:
    """Return places by temperature reading of a device, and for inertial units places and sensors."""
    readings: dict[str, str] = {}
    imu_readings: dict[str, tuple[str, str]] = {}
    for name, place in bench.places.items():
        shown = bench.readings[place.temperature]
        if place.channels is None and shown.device == role:
            readings[shown.channel] = name
        for reading, at in thermometers_at(place).items():
            each = bench.readings[reading]
            if each.device == role:
                imu_readings[each.channel] = name, at
    return readings, imu_readings


def thermometers_at(place: PlaceEntry) -> dict[str, str]:
    """Return where in an inertial unit each reading is taken: in a triad, at a sensor by its channel, or CIRCUIT."""
    if place.channels is None:
        return {}
    circuit = {} if place.circuit is None else {place.circuit.output: CIRCUIT}
    own = {reading: channel for channel, reading in reversed([*place.at_sensors.items()])}
    of_triads = (place.temperature, place.gyro_temperature or place.temperature)
    return own | dict(zip(of_triads, SENSORS, strict=True)) | circuit


def decoding_of(bench: BenchFile, channel: str | None) -> Decoding | None:
    """Return the decoding of the codes on a channel of samples; None if no device sends them."""
    for entry in bench.devices.values():
        if channel is not None and isinstance(entry.outputs.get(channel), Sampled):
            return Decoding(*Decoder(entry).scales.get(channel, ()))
    return None


def _check_sends(bench: BenchFile, place: str, unit: object) -> None:
    """Raise InputError if the file of a unit has no `telemetry`, or if only some of its channels are used."""
    if not isinstance(unit, UnitFile | GyroFile | ImuFile) or unit.telemetry is None:
        raise InputError(f"the simulated unit of place '{place}' sends no codes: its file needs 'telemetry'")
    if isinstance(unit, ImuFile) and len(bench.sent_units(bench.places[place])) < len(CHANNELS):
        raise InputError(f"the simulated unit of place '{place}' sends all of its channels; declare all of them")
