"""Bench file keys of the thermometer."""

from __future__ import annotations

from drivers.capabilities import THERMOMETER
from drivers.description import DriverDescription

TEMPERATURE = "temperature"

DESCRIPTION = DriverDescription(
    name="toy_thermometer",
    title="fictitious thermometer",
    capabilities=frozenset({THERMOMETER}),
    schemes=frozenset({"serial", "tcp"}),
    target="toy_thermometer.driver:ToyThermometer",
    simulator="toy_thermometer.simulator:SimulatedToyThermometer",
    channels={TEMPERATURE: "°C"},
)
