"""Table of shipped drivers: their descriptions, which import nothing of the drivers themselves."""

from __future__ import annotations

from collections.abc import Mapping

_DIALECTS = (
    "acutronic_acl", "aerotech_ensemble", "agilent_34970a", "binder", "can_counter", "can_telemetry", "cts",
    "espec_p300", "fluke_5700a", "keithley_6220", "keysight_3458a", "modbus_chamber", "newport_xps", "operator_head",
    "scpi_supply", "simserv", "watlow_f4", "watlow_f4t", "yokogawa_gs200",
)  # fmt: skip
DRIVERS: Mapping[str, str] = {
    **{name: f"drivers.dialects.{name}.description:DESCRIPTION" for name in _DIALECTS},
    "framed_head": "drivers.dialects.framed.description:HEAD",
    "framed_table": "drivers.dialects.framed.description:TABLE",
    "keysight_3458a_ammeter": "drivers.dialects.keysight_3458a.ammeter:DESCRIPTION",
}
