"""A thermal chamber with a Watlow F4 S or D: its temperature channel."""

from __future__ import annotations

from drivers.description import Setup
from drivers.dialects.watlow_f4.controller import F4Channel
from drivers.dialects.watlow_f4.description import F4Options
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe
from drivers.kinds.chamber.driver import Chamber
from drivers.transport.modbus import ModbusLink


class WatlowF4(Chamber):
    """A ThermalChamber whose set point goes in steps."""

    def __init__(self, setup: Setup[F4Options, ChamberLimits, ChamberSafe]) -> None:
        options = setup.options
        link = ModbusLink(
            setup.name, setup.wires, setup.address, unit_id=options.unit_id, answer_s=options.answer_timeout
        )
        channel = F4Channel(link, setup.identity, options.power_event, setup.note)
        super().__init__(setup.name, channel, setup.limits, setup.safe, options)
