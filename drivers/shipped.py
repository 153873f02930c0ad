"""Table of shipped drivers: their descriptions, which import nothing of the drivers themselves."""

from __future__ import annotations

from collections.abc import Mapping

DRIVERS: Mapping[str, str] = {
    "agilent_34970a": "drivers.dialects.agilent_34970a.description:DESCRIPTION",
    "acutronic_acl": "drivers.dialects.acutronic_acl.description:DESCRIPTION",
    "aerotech_ensemble": "drivers.dialects.aerotech_ensemble.description:DESCRIPTION",
    "binder": "drivers.dialects.binder.description:DESCRIPTION",
    "can_counter": "drivers.dialects.can_counter.description:DESCRIPTION",
    "can_telemetry": "drivers.dialects.can_telemetry.description:DESCRIPTION",
    "cts": "drivers.dialects.cts.description:DESCRIPTION",
    "espec_p300": "drivers.dialects.espec_p300.description:DESCRIPTION",
    "fluke_5700a": "drivers.dialects.fluke_5700a.description:DESCRIPTION",
    "framed_head": "drivers.dialects.framed.description:HEAD",
    "framed_table": "drivers.dialects.framed.description:TABLE",
    "keithley_6220": "drivers.dialects.keithley_6220.description:DESCRIPTION",
    "keysight_3458a": "drivers.dialects.keysight_3458a.description:DESCRIPTION",
    "keysight_3458a_ammeter": "drivers.dialects.keysight_3458a.ammeter:DESCRIPTION",
    "modbus_chamber": "drivers.dialects.modbus_chamber.description:DESCRIPTION",
    "newport_xps": "drivers.dialects.newport_xps.description:DESCRIPTION",
    "operator_head": "drivers.dialects.operator_head.description:DESCRIPTION",
    "scpi_supply": "drivers.dialects.scpi_supply.description:DESCRIPTION",
    "simserv": "drivers.dialects.simserv.description:DESCRIPTION",
    "watlow_f4": "drivers.dialects.watlow_f4.description:DESCRIPTION",
    "watlow_f4t": "drivers.dialects.watlow_f4t.description:DESCRIPTION",
    "yokogawa_gs200": "drivers.dialects.yokogawa_gs200.description:DESCRIPTION",
}
