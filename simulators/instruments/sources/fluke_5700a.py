"""A Fluke 5700A with a load resistor: output, range lock, settling, trips, remote and local, and fault queue."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import ClassVar, Self

from drivers.dialects.fluke_5700a import wire
from drivers.dialects.fluke_5700a.wire import Event, Status, Terminator
from drivers.protocols.scpi import number
from drivers.protocols.texts import matched
from simulators.faults.instrument_faults import COMMAND_FAULTS, FaultEffect, FaultKind, FaultPlan
from simulators.instruments.setup import InstrumentSetup
from simulators.world import World

# Only the first is documented; the manual's list of the others could not be had, so these numbers are made up.
ILLEGAL_LIMIT, UNKNOWN_COMMAND, BAD_PARAMETER, OUT_OF_RANGE, OVERLOAD, QUEUE_OVERFLOW = 725, 901, 902, 903, 904, 905
_EXPLAINED = {
    ILLEGAL_LIMIT: "ILLEGAL LIMIT SETTING", UNKNOWN_COMMAND: "UNKNOWN COMMAND", BAD_PARAMETER: "BAD PARAMETER",
    OUT_OF_RANGE: "OUTSIDE LOCKED RANGE", OVERLOAD: "OUTPUT OVERLOAD", QUEUE_OVERFLOW: "FAULT QUEUE OVERFLOW",
}  # fmt: skip
QUEUE_LENGTH = 16
_EVENT_SUMMARY, _REGISTER_MOST = 1 << 5, 255
_EVENTS = {UNKNOWN_COMMAND: Event.COMMAND_ERROR, BAD_PARAMETER: Event.COMMAND_ERROR, OVERLOAD: Event.DEVICE_ERROR}
_NO_EFFECT = {  # commands without effect here: their arguments
    "*WAI": "", "*OPC": "", "EXTGUARD": "ON|OFF", "EXTSENSE": "ON|OFF", "CUR_POST": "NORMAL|AUX|IB5725",
    "LIMIT": "[^,]+,[^,]+",
}  # fmt: skip
_AMPLITUDES = ("V", "A", "OHM")
_OUTPUTS = ("OUT", "OPER", "STBY", "RANGELCK", "*RST")
_EITHER_END = bytes.maketrans(b"\r", b"\n")
_QUANTITY = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:E[+-]?\d+)?)\s*([A-Z]+)", re.ASCII)
_UNITS = ("HZ", "V", "A", "OHM", "DB", "DBM", "PCT", "PPM")
_MULTIPLIERS = {"": 1.0, "K": 1e3, "M": 1e-3, "U": 1e-6, "MA": 1e6}
_MEGA = {"MOHM": "OHM", "MHZ": "HZ"}


class SimulatedFluke:
    """A calibrator in front of `load_ohm`; it accepts commands only in remote, and always answers queries.

    A load that needs more than `compliance_v` trips it to standby. The status follows an operate or standby after
    `relay_s`, and reports a settled output `settle_s` after a change. `busy` leaves received data in the input buffer;
    `terminal` echoes them. `stuck`: settings are accepted and not executed. There are no measured values for `frozen`.
    """

    def __init__(
        self, world: World, faults: FaultPlan, *, model: str = "5720A", serial: str = "SIM-5720A-01",
        load_ohm: float = 100.0, compliance_v: float = 10.0, terminator: Terminator = "crlf",
    ) -> None:  # fmt: skip
        self.faults = faults
        self.load_ohm, self.compliance_v = load_ohm, compliance_v
        self.settle_s, self.relay_s = 3.0, 0.1
        self.terminal = self.busy = False
        self.life_min = 123_456  # time of operation at the start of the world
        self.end = wire.TERMINATORS[terminator]
        self._world, self._identity = world, f"FLUKE,{model},{serial},1.4+A,1.1,0.0"
        self._queue: deque[int] = deque()
        self._events, self._enabled = Event.POWER_ON, {"*ESE": 0, "*SRE": 0}
        self.remote = self.output = self.range_locked = False
        self.level, self.unit, self.frequency_hz, self.range_a = 0.0, "V", 0.0, wire.RANGES_A[0]
        self.modes = Status(0)  # boost, offset and scale, as set at the front panel
        self._changed_s = self._switched_s = -math.inf
        self._told: Mapping[str, Callable[[], str]] = {
            "*IDN?": lambda: self._identity,
            "*OPC?": lambda: "1",
            "*TST?": lambda: "0",
            "*ESR?": self._take_events,
            "*STB?": lambda: str(_EVENT_SUMMARY if self._events & self._enabled["*ESE"] else 0),
            "*ESE?": lambda: str(self._enabled["*ESE"]),
            "*SRE?": lambda: str(self._enabled["*SRE"]),
            "ISR?": lambda: str(int(self._status())),
            "OUT?": lambda: f"{self.level:.7E},{self.unit},{self.frequency_hz:.2E}",
            "ETIME?": lambda: str(self.life_min + int(self._world.now() // 60)),
            "FAULT?": lambda: str(self._queue.popleft() if self._queue else wire.NO_FAULT),
        }

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """Create from a bench file."""
        return cls(
            setup.world, setup.faults, model=setup.model or "5720A", serial=setup.serial or "SIM-5720A-01",
            compliance_v=setup.options.compliance, terminator=setup.options.terminator,
        )  # fmt: skip

    def session(self) -> FlukeSession:
        """Open a connection."""
        return FlukeSession(self)

    @property
    def current_a(self) -> float:
        """True output current."""
        self._trip_on_overload()
        return self.level if self.output and self._is_dc_current else 0.0

    @property
    def feeds_a(self) -> float | None:
        """Current at its terminals, independent of the load; None in standby."""
        return self.level if self.output and self._is_dc_current else None

    @property
    def _is_dc_current(self) -> bool:
        return self.unit == "A" and self.frequency_hz == 0

    def restart(self) -> None:
        """Short power failure: all settings are as at power-on."""
        self._reset_output()
        self.remote = False
        self._queue.clear()
        self._events = Event.POWER_ON

    def overload(self) -> None:
        """Overload: it goes to standby and reports the reason."""
        self._switch(False)
        self.fault(OVERLOAD)

    def local(self) -> None:
        """Press the front-panel key that ends remote control."""
        self.remote = False

    def execute(self, message: str) -> list[str]:
        """Execute the commands of a message; return the answers to its queries."""
        self._trip_on_overload()
        answers: list[str] = []
        for command in filter(None, (part.strip().upper() for part in message.split(";"))):
            header, _, rest = command.partition(" ")
            arguments = [argument.strip() for argument in rest.split(",")] if rest else []
            if header.endswith("?"):
                answers += self._answer(header, arguments)
            elif header in _NO_EFFECT:
                if not re.fullmatch(_NO_EFFECT[header], ",".join(arguments)):
                    self.fault(BAD_PARAMETER)
            elif header in _OUTPUTS:
                self.faults.carry_out(partial(self._command_output, header, arguments))
            else:
                self._execute(header, arguments)
        return answers

    def fault(self, code: int) -> None:
        """Add a fault to the queue; the last entry of a full queue reports an overflow."""
        self._events |= _EVENTS.get(code, Event.EXECUTION_ERROR)
        if len(self._queue) < QUEUE_LENGTH:
            self._queue.append(code if len(self._queue) < QUEUE_LENGTH - 1 else QUEUE_OVERFLOW)

    def _answer(self, header: str, arguments: list[str]) -> list[str]:
        if header in self._told:
            return [self._told[header]()]
        if header == "EXPLAIN?" and len(arguments) == 1 and arguments[0].isdigit():
            return [f'"{_EXPLAINED.get(int(arguments[0]), "UNKNOWN FAULT")}"']
        self.fault(UNKNOWN_COMMAND)
        return []

    def _take_events(self) -> str:
        events, self._events = self._events, Event(0)
        return str(int(events))

    def _execute(self, header: str, arguments: list[str]) -> None:
        match header, arguments:
            case "REMOTE" | "LOCKOUT", []:
                self.remote = True
            case "LOCAL", []:
                self.remote = False
            case (("*ESE" | "*SRE"), [value]) if value.isdecimal() and int(value) <= _REGISTER_MOST:
                self._enabled[header] = int(value)
            case "*CLS", []:
                self._queue.clear()
                self._events = Event(0)
            case _:
                self.fault(UNKNOWN_COMMAND)

    def _command_output(self, header: str, arguments: list[str]) -> None:
        """Execute a command that is accepted in remote only."""
        if not self.remote:
            return
        match header, arguments:
            case "*RST", []:
                self._reset_output()
            case "OPER" | "STBY", []:
                self._switch(header == "OPER")
            case "RANGELCK", ["ON" | "OFF"]:
                self.range_locked = arguments == ["ON"]
            case "OUT", [_] | [_, _]:
                self._set_output(arguments)
            case _:
                self.fault(BAD_PARAMETER)

    def _set_output(self, arguments: list[str]) -> None:
        """Set amplitude and frequency, or one of them; decibels are not supported."""
        level, unit, frequency_hz = self.level, self.unit, self.frequency_hz
        try:
            for place, argument in enumerate(arguments):
                value, its_unit = quantity(argument)
                if its_unit == "HZ" and place == len(arguments) - 1:
                    frequency_hz = value
                elif its_unit in _AMPLITUDES and place == 0:
                    level, unit = value, its_unit
                else:
                    return self.fault(BAD_PARAMETER)
        except ValueError:
            return self.fault(BAD_PARAMETER)
        if unit == "A" and not (self.range_locked and self.unit == "A"):
            self.range_a = next((range_a for range_a in wire.RANGES_A if abs(level) < range_a), self.range_a)
        if unit == "A" and abs(level) >= self.range_a:
            return self.fault(OUT_OF_RANGE)
        self._world.before_change()
        self.level, self.unit, self.frequency_hz = level, unit, frequency_hz
        self._changed_s = self._world.now()
        return None

    def _switch(self, on: bool) -> None:
        if on != self.output:
            self._world.before_change()
            self.output = on
            self._changed_s = self._switched_s = self._world.now()

    def _trip_on_overload(self) -> None:
        if self.output and self.unit == "A" and abs(self.level) * self.load_ohm > self.compliance_v:
            self.overload()

    def _status(self) -> Status:
        status, now_s = self.modes, self._world.now()
        if self.output == (now_s - self._switched_s >= self.relay_s):
            status |= Status.OPERATING
        if self.output and now_s - self._changed_s >= self.settle_s:
            status |= Status.SETTLED
        if self.range_locked:
            status |= Status.RANGE_LOCKED
        return status | Status.REMOTE if self.remote else status

    def _reset_output(self) -> None:
        self._world.before_change()
        self.output = self.range_locked = False
        self.level, self.unit, self.frequency_hz = 0.0, "V", 0.0
        self.modes = Status(0)
        self._changed_s = self._switched_s = -math.inf

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **COMMAND_FAULTS,
        "restart": FaultEffect(restart),
        "front_panel": FaultEffect(local),
        "tripped": FaultEffect(overload),
    }


class FlukeSession:
    """One connection: a message ends at a CR or an LF, and the input buffer takes 128 bytes.

    Further bytes are lost. XOFF requests a pause at three quarters, XON ends it.
    """

    def __init__(self, instrument: SimulatedFluke) -> None:
        self._instrument = instrument
        self._buffer = b""
        self._paused = False

    def feed(self, data: bytes) -> bytes:
        """Take bytes in any portions; return the immediate answer."""
        source = self._instrument
        said = data if source.terminal else b""
        if source.busy:
            self._buffer = (self._buffer + data)[: wire.INPUT_BUFFER_BYTES]
            if not self._paused and 4 * len(self._buffer) > 3 * wire.INPUT_BUFFER_BYTES:
                self._paused = True
                said += wire.XOFF
            return said
        *lines, rest = (self._buffer + data).translate(_EITHER_END).split(b"\n")
        self._buffer = rest[: wire.INPUT_BUFFER_BYTES]
        if self._paused:
            self._paused = False
            said += wire.XON
        for line in lines:
            said += b"".join(answer.encode() + source.end for answer in source.execute(line.decode("latin-1")))
        return said


def quantity(text: str) -> tuple[float, str]:
    """Parse a value in a unit with multiplier, from capitals like `10V`, `1.2 MA` or `1KHZ`; ValueError."""
    match = matched(_QUANTITY, text, f"'{text}' is not a number with a unit")
    value, word = number(match[1]), match[2]
    if word in _MEGA:
        return 1e6 * value, _MEGA[word]
    for multiplier, factor in _MULTIPLIERS.items():
        if word.startswith(multiplier) and word[len(multiplier) :] in _UNITS:
            return factor * value, word[len(multiplier) :]
    raise ValueError(f"'{word}' is no unit")
