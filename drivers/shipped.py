"""The drivers that the program brings: the description of each, which imports nothing of the driver itself."""

from __future__ import annotations

from collections.abc import Mapping

DRIVERS: Mapping[str, str] = {
    "agilent_34970a": "drivers.agilent_34970a.description:DESCRIPTION",
    "acutronic_acl": "drivers.acutronic_acl.description:DESCRIPTION",
    "aerotech_ensemble": "drivers.aerotech_ensemble.description:DESCRIPTION",
    "binder": "drivers.binder.description:DESCRIPTION",
    "can_counter": "drivers.can_counter.description:DESCRIPTION",
    "can_telemetry": "drivers.can_telemetry.description:DESCRIPTION",
    "cts": "drivers.cts.description:DESCRIPTION",
    "espec_p300": "drivers.espec_p300.description:DESCRIPTION",
    "fluke_5700a": "drivers.fluke_5700a.description:DESCRIPTION",
    "framed_head": "drivers.framed.description:HEAD",
    "framed_table": "drivers.framed.description:TABLE",
    "keithley_6220": "drivers.keithley_6220.description:DESCRIPTION",
    "keysight_3458a": "drivers.keysight_3458a.description:DESCRIPTION",
    "keysight_3458a_ammeter": "drivers.keysight_3458a.ammeter:DESCRIPTION",
    "modbus_chamber": "drivers.modbus_chamber.description:DESCRIPTION",
    "newport_xps": "drivers.newport_xps.description:DESCRIPTION",
    "operator_head": "drivers.operator_head.description:DESCRIPTION",
    "scpi_supply": "drivers.scpi_supply.description:DESCRIPTION",
    "simserv": "drivers.simserv.description:DESCRIPTION",
    "watlow_f4": "drivers.watlow_f4.description:DESCRIPTION",
    "watlow_f4t": "drivers.watlow_f4t.description:DESCRIPTION",
    "yokogawa_gs200": "drivers.yokogawa_gs200.description:DESCRIPTION",
}
