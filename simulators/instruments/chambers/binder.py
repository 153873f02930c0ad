"""A Binder chamber with an MB1 or MB2: its temperature registers, mode and operation lines.

The idle state is not simulated: a new set point is stored until it becomes active.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar, Self

from drivers.dialects.binder.wire import (
    ALARM,
    BASIC,
    DOOR,
    IDLE_LINE,
    LINES,
    MANUAL,
    MODE,
    PROGRAM_STOP,
    Kind,
    Mode,
    SetPointName,
    registers_of,
    value_c,
    words,
)
from simulators.faults.instrument_faults import PASSIVE_FAULT, FaultEffect, FaultKind, FaultPlan, sets
from simulators.instruments.chambers.chamber import CHAMBER_FAULT_EFFECTS, SimulatedChamber
from simulators.instruments.modbus import ExceptionCode, ModbusRtuSession, ModbusServer, RegisterError
from simulators.instruments.setup import InstrumentSetup
from simulators.world import World

ANSWER_AFTER_S = 0.25
AFTER_RESTART_C = 25.0  # set point after a power cycle
PROGRAM_C = 40.0  # set point of a program started at the panel
_LINES_READ = 0x1292


class SimulatedBinder(SimulatedChamber):
    """Registers of one controller, which answers after 0.25 s.

    An MB1 activates a set point when its mode is written, so a mode written before its set point restores the old one;
    an MB2 activates it at once. Temperatures outside `range_c`, halves of a temperature and invalid modes are refused
    with exception 3; an unknown register, and a write to a read-only one, with exception 2.
    """

    def __init__(
        self, world: World, faults: FaultPlan, *, kind: Kind = "mb1", swapped: bool = False, unit_id: int = 1,
        range_c: tuple[float, float] = (-70.0, 180.0),
    ) -> None:  # fmt: skip
        super().__init__(world, faults)
        self.kind, self.swapped = kind, swapped
        self.alarm = self.door = 0
        self.program_runs = False
        self._range_c, self._restarts = range_c, 0
        self._server = ModbusServer(self, unit_id)
        self._mode, self._lines = Mode.MANUAL, 0
        start = words(world.thermal.set_point_c)
        self._set_points = dict.fromkeys((BASIC, MANUAL, registers_of("mb2", "manual", swapped=False).set_point), start)

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """Create from a bench file."""
        options = setup.options
        found = cls(
            setup.world, setup.faults, kind=options.controller, swapped=options.swapped, unit_id=options.unit_id,
            range_c=(options.range.min, options.range.max),
        )  # fmt: skip
        found._mode = Mode.BASIC if options.set_point == "basic" else Mode.MANUAL
        return found

    def session(self) -> ModbusRtuSession:
        """Open a connection."""
        return ModbusRtuSession(self._server, self._world.now, answer_after_s=ANSWER_AFTER_S)

    def read(self, address: int, count: int) -> Sequence[int]:
        """Read words from `address`."""
        self._world.look()
        self._restart_once()
        held = self._held()
        if any(each not in held for each in range(address, address + count)):
            raise RegisterError(ExceptionCode.ILLEGAL_ADDRESS)
        return [held[each] for each in range(address, address + count)]

    def write(self, address: int, words: Sequence[int]) -> None:
        """Write one temperature or one word."""
        self._restart_once()
        if address in self._here():
            self._write_set_point(address, tuple(words))
        elif address == (MODE if self.kind == "mb1" else LINES) or (address == PROGRAM_STOP and self.kind == "mb2"):
            self._write_word(address, words)
        else:
            raise RegisterError(ExceptionCode.ILLEGAL_ADDRESS)

    def move_door(self, *, is_open: bool) -> None:
        """Open or close the door, with its contact."""
        super().move_door(is_open=is_open)
        self.door = int(is_open)

    def start_program(self) -> None:
        """Start a program at the front panel."""
        self.program_runs, self._mode = True, Mode.PROGRAM
        self._world.ramp(PROGRAM_C, 1 / 60)

    def _here(self) -> tuple[int, ...]:
        """Register addresses of this controller's set points."""
        return (BASIC, MANUAL) if self.kind == "mb1" else (registers_of("mb2", "manual", swapped=False).set_point,)

    def _held(self) -> Mapping[int, int]:
        at = registers_of(self.kind, "manual", swapped=False)
        pairs = {address: self._set_points[address] for address in self._here()}
        pairs[at.process_value] = words(self.measured_c())
        pairs[at.set_point_in_force] = words(self._world.thermal.set_point_c)
        held = {address + half: pair[half] for address, pair in pairs.items() for half in (0, 1)}
        if self.kind == "mb1":
            return held | {MODE: self._mode, ALARM: self.alarm, DOOR: self.door}
        return held | {LINES: self._lines, _LINES_READ: self._lines}

    def _write_set_point(self, address: int, pair: tuple[int, ...]) -> None:
        low_c, high_c = self._range_c
        try:
            good = len(pair) == 2 and low_c <= value_c(pair) <= high_c
        except ValueError:
            good = False
        if not good:
            raise RegisterError(ExceptionCode.ILLEGAL_VALUE)
        self.faults.carry_out(lambda: self._put_set_point(address, pair))

    def _put_set_point(self, address: int, pair: tuple[int, ...]) -> None:
        self._set_points[address] = pair
        if self.kind == "mb2":
            self._follow()

    def _write_word(self, address: int, words: Sequence[int]) -> None:
        (word,) = words if len(words) == 1 else (-1,)
        if word < 0 or (address == MODE and word not in list(Mode)):
            raise RegisterError(ExceptionCode.ILLEGAL_VALUE)
        self.faults.carry_out(lambda: self._put_word(address, word))

    def _put_word(self, address: int, word: int) -> None:
        if address == MODE:
            self._mode, self.program_runs = Mode(word), word == Mode.PROGRAM
        elif address == LINES:
            self._lines = word
        else:
            self.program_runs = False
        self._follow()

    def _follow(self) -> None:
        """Activate the selected set point."""
        if self.program_runs:
            return
        if self.kind == "mb2":
            if not self._lines & IDLE_LINE:
                self._world.ramp(value_c(self._set_points[self._here()[0]]), math.inf)
        elif self._mode in (Mode.BASIC, Mode.MANUAL):
            name: SetPointName = "basic" if self._mode == Mode.BASIC else "manual"
            at = registers_of("mb1", name, swapped=self.swapped)
            self._world.ramp(value_c(self._set_points[at.set_point]), math.inf)

    def _restart_once(self) -> None:
        """Restart after a short power failure."""
        if self.faults.times("restart") > self._restarts:
            self._restarts, self.program_runs, self._mode = self._restarts + 1, False, Mode.MANUAL
            self._set_points = dict.fromkeys(self._set_points, words(AFTER_RESTART_C))
            self._follow()

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **CHAMBER_FAULT_EFFECTS,
        "restart": PASSIVE_FAULT,
        "program": FaultEffect(start_program),
        "alarm": sets("alarm", 1, 0),
    }
