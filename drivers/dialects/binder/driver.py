"""A thermal chamber of Binder's."""

from __future__ import annotations

from drivers.description import Setup
from drivers.dialects.binder.controller import Mb1, Mb2
from drivers.dialects.binder.description import BinderOptions
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe
from drivers.kinds.chamber.driver import Chamber
from drivers.transport.modbus import ModbusLink


class Binder(Chamber):
    """A ThermalChamber whose set point goes in steps."""

    def __init__(self, setup: Setup[BinderOptions, ChamberLimits, ChamberSafe]) -> None:
        options = setup.options
        link = ModbusLink(
            setup.name, setup.wires, setup.address, unit_id=options.unit_id, answer_s=options.answer_timeout
        )
        made = Mb1 if options.controller == "mb1" else Mb2
        controller = made(link, setup.identity, options, setup.note)
        super().__init__(setup.name, controller, setup.limits, setup.safe, options)
