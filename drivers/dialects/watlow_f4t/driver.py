"""A thermal chamber with a Watlow F4T: one control loop in data map 1."""

from __future__ import annotations

from drivers.description import Setup
from drivers.dialects.watlow_f4t.controller import F4TLoop
from drivers.dialects.watlow_f4t.description import F4TOptions
from drivers.dialects.watlow_f4t.wire import LoopFormat
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe
from drivers.kinds.chamber.driver import Chamber
from drivers.transport.modbus import ModbusLink


class WatlowF4T(Chamber):
    """A ThermalChamber that ramps by itself."""

    def __init__(self, setup: Setup[F4TOptions, ChamberLimits, ChamberSafe]) -> None:
        options = setup.options
        link = ModbusLink(
            setup.name, setup.wires, setup.address, unit_id=options.unit_id, answer_s=options.answer_timeout
        )
        form = LoopFormat(options.loop, options.word_order)
        loop = F4TLoop(link, form, setup.identity, setup.note, block_reads=options.block_reads)
        super().__init__(setup.name, loop, setup.limits, setup.safe, options)
