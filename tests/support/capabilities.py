"""Protocol of each capability of a driver."""

from collections.abc import Mapping

from drivers.capabilities import (
    Ammeter,
    Positioner,
    PulseCounter,
    RateTable,
    Source,
    Telemetry,
    ThermalChamber,
    Voltmeter,
)

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
