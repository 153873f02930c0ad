"""A Weiss or Vötsch chamber with a SIMPAC controller: SIMSERV messages in front of the world's chamber.

The off state is not simulated: a new set point is stored until the chamber is started.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import ClassVar, Self

from drivers.dialects.simserv import wire
from drivers.dialects.simserv.wire import Function, Info, Reads, Status
from drivers.kinds.chamber.tenths import as_stored
from simulators.faults.instrument_faults import FaultEffect, FaultKind, FaultPlan
from simulators.instruments.chambers.chamber import CHAMBER_FAULT_EFFECTS, SimulatedChamber
from simulators.instruments.scpi import LineSession
from simulators.instruments.setup import InstrumentSetup
from simulators.world import World

PROGRAMS: Mapping[int, tuple[float, float]] = {1: (80.0, 1.0), 2: (-20.0, 0.5)}  # target, °C, and rate, °C/min
MESSAGES = ("Door open", "Temperature limiter", "Water supply")
NO_SUCH_CHAMBER, UNKNOWN, WRONG_ARGUMENTS, NOTHING_THERE, NOT_CARRIED_OUT = -4, -5, -6, -8, -9
OUTPUTS = 16
# Further queries of third-party programs, with the numbers of the manual of 2019 as in SengerM's package.
_VARIABLES, _VARIABLE_NAME, _OUTPUTS, _OUTPUT_NAME = 11018, 11026, 14007, 14010
_LOW_LIMITS, _HIGH_LIMITS = (11014, 11016), (11015, 11017)  # numbers of alarms and warnings
_MEASURED_VALUES, _INPUTS, _PROGRAM = 12012, 15004, 19204
_OUTPUT_NAMES = {1: "Start", 7: "Compressed air", 8: "Dryer"}


class Refusal(Exception):
    """A rejected command, with the number in its answer."""

    def __init__(self, code: int) -> None:
        super().__init__(str(code))
        self.code = code


class SimulatedSimserv(SimulatedChamber):
    """A chamber with one control variable, its temperature.

    `set_point_reads` selects the set point reported during a ramp. `error` stops it with a message that is active until
    errors are cleared and its cause is gone. `stuck`: settings are accepted and not executed. `frozen`: the air reading
    does not change.
    """

    def __init__(
        self, world: World, faults: FaultPlan, *, kind: str = "WT3-180/70", serial: str = "59226001",
        set_point_reads: Reads = "target", limits_c: tuple[float, float] = (-75.0, 185.0),
    ) -> None:  # fmt: skip
        super().__init__(world, faults)
        self.kind, self.serial, self.limits_c = kind, serial, limits_c
        self.set_point_c = as_stored(world.thermal.set_point_c)
        self.gradients: dict[Function, float] = {Function.GRADIENT_UP: 0.0, Function.GRADIENT_DOWN: 0.0}
        self.outputs = {1: True}
        self.program = 0
        self.active: set[int] = set()
        self._reads = set_point_reads
        self._functions: Mapping[int, tuple[int, Callable[..., object]]] = {
            Function.INFO: (1, self._info),
            Function.STATUS: (0, self._status),
            Function.SET_POINT: (1, lambda _: _decimal(self._told_c())),
            Function.PROCESS_VALUE: (1, lambda _: f"{self.measured_c():.1f}"),
            Function.LOWEST: (1, lambda _: f"{self.limits_c[0]:.1f}"),
            Function.HIGHEST: (1, lambda _: f"{self.limits_c[1]:.1f}"),
            Function.UNIT: (1, lambda _: "°C"),
            Function.GRADIENT_UP: (1, lambda _: f"{self.gradients[Function.GRADIENT_UP]:g}"),
            Function.GRADIENT_DOWN: (1, lambda _: f"{self.gradients[Function.GRADIENT_DOWN]:g}"),
            Function.SWITCHED: (1, self._switched),
            Function.MESSAGES: (0, lambda: len(MESSAGES)),
            Function.MESSAGE_TEXT: (1, lambda index: _one_of(MESSAGES, index)),
            Function.MESSAGE_ACTIVE: (1, lambda index: int(_one_of(MESSAGES, index) in self._active_texts())),
            Function.PROGRAM_STATUS: (0, lambda: int(bool(self.program))),
            _VARIABLES: (0, lambda: 1),
            _VARIABLE_NAME: (1, lambda index: _one_of(("Temperature",), index)),
            **dict.fromkeys(_LOW_LIMITS, (1, lambda _: _decimal(self.limits_c[0]))),
            **dict.fromkeys(_HIGH_LIMITS, (1, lambda _: _decimal(self.limits_c[1]))),
            _OUTPUTS: (0, lambda: OUTPUTS),
            _OUTPUT_NAME: (1, self._output_name),
            **dict.fromkeys((_MEASURED_VALUES, _INPUTS), (0, lambda: 0)),
            _PROGRAM: (0, lambda: self.program),
        }
        self._settings: Mapping[int, tuple[int, Callable[..., None]]] = {
            Function.SET_SET_POINT: (2, self._set_set_point),
            Function.SET_GRADIENT_UP: (2, lambda _, rate: self._set_gradient(Function.GRADIENT_UP, rate)),
            Function.SET_GRADIENT_DOWN: (2, lambda _, rate: self._set_gradient(Function.GRADIENT_DOWN, rate)),
            Function.SWITCH: (2, self._switch),
            Function.CLEAR_ERRORS: (0, self.active.clear),
            Function.START_PROGRAM: (2, self._run),
            Function.STOP_PROGRAM: (0, self._end_program),
        }

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """Create from a bench file."""
        return cls(
            setup.world, setup.faults, kind=setup.model or "WT3-180/70", serial=setup.serial or "59226001",
            set_point_reads=setup.options.set_point_reads,
        )  # fmt: skip

    def session(self) -> LineSession:
        """Open a connection."""
        return LineSession(self.execute, end=wire.END, answer_end=wire.ANSWER_END)

    def execute(self, line: str) -> str:
        """Answer to one message."""
        self._world.look()
        try:
            return self._carry_out(line.split(wire.SEPARATOR))
        except Refusal as refusal:
            return str(refusal.code)

    def error(self, index: int) -> None:
        """Raise an error that stops the chamber, with an active message, numbered from 1."""
        self.active.add(index)
        self.outputs[wire.START] = False

    def move_door(self, *, is_open: bool) -> None:
        """Open the door, whose contact stops the chamber with a message, or close it; the chamber stays off."""
        super().move_door(is_open=is_open)
        if is_open:
            self.error(1)
        else:
            self.active.discard(1)

    def start_program(self) -> None:
        """Start a program at the front panel, if the chamber allows it."""
        if not self.active:
            self._run("1", "1")

    def restart(self) -> None:
        """Short power failure: it restarts switched off."""
        self.outputs.clear()
        self.program = 0

    def _carry_out(self, fields: list[str]) -> str:
        if len(fields) < 2 or not all(field.isdecimal() for field in fields[:2]):
            raise Refusal(WRONG_ARGUMENTS)
        function, chamber, arguments = int(fields[0]), fields[1], fields[2:]
        if chamber != "1":
            raise Refusal(NO_SUCH_CHAMBER)
        if function in self._functions:
            count, ask = self._functions[function]
            return f"{wire.DONE}{wire.SEPARATOR}{_called(ask, count, arguments)}"
        if function not in self._settings:
            raise Refusal(UNKNOWN)
        count, carry_out = self._settings[function]
        self.faults.carry_out(partial(_called, carry_out, count, arguments), Refusal)
        return str(wire.DONE)

    def _info(self, what: str) -> str:
        return _one_of((self.kind, "26", self.serial), what, first=Info.TYPE)

    def _status(self) -> int:
        status = Status.AVAILABLE
        if self._runs:
            status |= Status.RUNNING
        if self.active:
            status |= Status.ERROR
        return int(status)

    @property
    def _runs(self) -> bool:
        return self.outputs.get(wire.START, False)

    def _active_texts(self) -> set[str]:
        return {MESSAGES[index - 1] for index in self.active}

    def _set_set_point(self, variable: str, value: str) -> None:
        value_c = float(value)
        if variable != str(wire.TEMPERATURE) or not self.limits_c[0] <= value_c <= self.limits_c[1]:
            raise Refusal(WRONG_ARGUMENTS)
        self.set_point_c = value_c
        self._follow()

    def _set_gradient(self, which: Function, rate: str) -> None:
        if not (rate_c_per_min := float(rate)) >= 0:
            raise Refusal(WRONG_ARGUMENTS)
        self.gradients[which] = rate_c_per_min

    def _switched(self, output: str) -> int:
        return int(self.outputs.get(_output(output), False))

    def _output_name(self, output: str) -> str:
        number = _output(output)
        return _OUTPUT_NAMES.get(number, f"Output {number}")

    def _switch(self, output: str, on: str) -> None:
        _output(output)
        if on not in ("0", "1"):
            raise Refusal(WRONG_ARGUMENTS)
        if int(output) == wire.START and on == "1" and self.active:
            raise Refusal(NOT_CARRIED_OUT)
        if int(output) == wire.START and on == "1" and not self._runs:
            self._world.ramp(self._world.thermal.air_c, math.inf)  # a ramp starts at the air temperature
        self.outputs[int(output)] = on == "1"
        self._follow()

    def _run(self, program: str, _times: str) -> None:
        if int(program) not in PROGRAMS:
            raise Refusal(NOTHING_THERE)
        if self.active:
            raise Refusal(NOT_CARRIED_OUT)
        self.program, self.outputs[wire.START] = int(program), True
        target_c, rate_c_per_min = PROGRAMS[self.program]
        self._world.ramp(target_c, rate_c_per_min / 60)

    def _end_program(self) -> None:
        if self.program:
            self.program, self.outputs[wire.START] = 0, False

    def _follow(self) -> None:
        """Ramp the active set point to the set point, at its gradient."""
        if not self._runs or self.program:
            return
        up = self.set_point_c > self._world.thermal.set_point_c
        rate_c_per_min = self.gradients[Function.GRADIENT_UP if up else Function.GRADIENT_DOWN]
        self._world.ramp(self.set_point_c, rate_c_per_min / 60 or math.inf)

    def _told_c(self) -> float:
        in_force = self.program or (self._runs and self._reads == "in_force")
        return self._world.thermal.set_point_c if in_force else self.set_point_c

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **CHAMBER_FAULT_EFFECTS,
        "restart": FaultEffect(restart),
        "program": FaultEffect(start_program, _end_program),
        "alarm": FaultEffect(lambda chamber: chamber.error(2), lambda chamber: chamber.active.discard(2)),
    }


def _called(function: Callable[..., object], count: int, arguments: list[str]) -> object:
    """Call a handler with as many arguments as it needs; further ones, such as a user name, are ignored."""
    if len(arguments) < count:
        raise Refusal(WRONG_ARGUMENTS)
    try:
        return function(*arguments[:count])
    except ValueError:
        raise Refusal(WRONG_ARGUMENTS) from None


def _decimal(value: float) -> str:
    """Format with as many decimals as necessary, one to three."""
    whole, _, digits = f"{value:.3f}".partition(".")
    return f"{whole}.{digits.rstrip('0') or '0'}"


def _output(text: str) -> int:
    """Number of a digital output; raises Refusal for an unknown one."""
    if not 1 <= int(text) <= OUTPUTS:
        raise Refusal(WRONG_ARGUMENTS)
    return int(text)


def _one_of(texts: tuple[str, ...], index: str, *, first: int = 1) -> str:
    place = int(index) - first
    if not 0 <= place < len(texts):
        raise Refusal(NOTHING_THERE)
    return texts[place]
