"""Common part of simulated SCPI instruments: line splitting, command table, status and error queue."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Mapping, Sequence

from drivers.protocols import scpi
from drivers.protocols.scpi import Command, ErrorEntry
from simulators.faults.instrument_faults import FaultPlan

Handler = Callable[[str], str | None]

UNDEFINED_HEADER = ErrorEntry(-113, "Undefined header")
WRONG_TYPE = ErrorEntry(-104, "Data type error")
NOT_ALLOWED = ErrorEntry(-108, "Parameter not allowed")
SETTINGS_CONFLICT = ErrorEntry(-221, "Settings conflict")
OUT_OF_RANGE = ErrorEntry(-222, "Data out of range")
ILLEGAL_VALUE = ErrorEntry(-224, "Illegal parameter value")
QUEUE_OVERFLOW = ErrorEntry(-350, "Queue overflow")
EMPTY = ErrorEntry(scpi.NO_ERROR, "No error")

ERROR_QUERIES = ("SYSTem:ERRor[:NEXT]?",)
QUEUE_LENGTH = 20
LINE_LIMIT_BYTES = 4096
SCPI_VERSION = "1997.0"
_EVENT_BITS = ((range(-199, -99), 5), (range(-299, -199), 4), (range(-399, -299), 3), (range(-499, -399), 2))
POWER_ON = 1 << 7
ERROR_AVAILABLE, EVENT_SUMMARY, MASTER_SUMMARY = 1 << 2, 1 << 5, 1 << 6  # bit of the status byte
_REGISTER_MOST = 255


class Refusal(Exception):
    """A rejected command, with its entry for the error queue."""

    def __init__(self, entry: ErrorEntry) -> None:
        super().__init__(str(entry))
        self.entry = entry


class Interpreter:
    """Parses messages and executes their commands by a table.

    `commands` maps headers in the notation of manuals to handlers: a handler gets the argument, returns the text of an
    answer, and raises Refusal. Common commands, status byte and error queue are part of this class. `signed` formats
    all error codes with a sign (`+0,"No error"`), as one maker does. `error_queries` are the queries of the error
    queue. `summary` returns the summary bits of the instrument's own registers in the status byte.
    """

    def __init__(
        self, identity: str, commands: Mapping[str, Handler], *, separator: str = ";", signed: bool = False,
        summary: Callable[[], int] = lambda: 0, error_queries: Sequence[str] = ERROR_QUERIES,
    ) -> None:  # fmt: skip
        self._separator, self._signed, self._summary = separator, signed, summary
        self._enabled = {"ESE": 0, "SRE": 0}
        self._errors: deque[ErrorEntry] = deque()
        self._events = POWER_ON
        table: dict[str, Handler] = {
            "*IDN?": lambda _: identity,
            "*CLS": self._clear,
            "*OPC?": lambda _: "1",
            "*OPC": self._complete,
            "*WAI": lambda _: None,
            "*ESR?": self._take_events,
            "*ESE": lambda argument: self._enable("ESE", argument),
            "*ESE?": lambda _: str(self._enabled["ESE"]),
            "*SRE": lambda argument: self._enable("SRE", argument),
            "*SRE?": lambda _: str(self._enabled["SRE"]),
            "*STB?": lambda _: str(self._status_byte()),
            "*TST?": lambda _: "0",
            "SYSTem:VERSion?": lambda _: SCPI_VERSION,
            **dict.fromkeys(error_queries, self._take_error),
            "STATus:PRESet": lambda _: None,
            **commands,
        }
        self._handlers: dict[str, Handler] = {}
        for header, handler in table.items():
            for spelling in scpi.spellings(header):
                self._handlers.setdefault(spelling, handler)

    def execute(self, message: str) -> str:
        """Execute a message; return the answers to its queries, joined, or "" without any."""
        answers = (self.carry_out(command) for command in scpi.commands(message))
        return self.joined([answer for answer in answers if answer is not None])

    def carry_out(self, command: Command) -> str | None:
        """Execute one command; return the answer to a query. A rejection is queued as an error."""
        try:
            return self._handler(command.header)(command.argument)
        except Refusal as refusal:
            self.note(refusal.entry)
            return None

    def joined(self, answers: Sequence[str]) -> str:
        """Join the answers to the queries of one message."""
        return self._separator.join(answers)

    def note(self, entry: ErrorEntry) -> None:
        """Queue an error and set its event bit."""
        for codes, bit in _EVENT_BITS:
            if entry.code in codes:
                self._events |= 1 << bit
        if len(self._errors) < QUEUE_LENGTH:
            self._errors.append(entry)
        else:
            self._errors[-1] = QUEUE_OVERFLOW

    def clear_errors(self) -> None:
        """Empty the error queue; the events stay."""
        self._errors.clear()

    def power_on(self) -> None:
        """Power-on: no errors, and the power-on event."""
        self._errors.clear()
        self._events = POWER_ON
        self._enabled = dict.fromkeys(self._enabled, 0)

    def _enable(self, register: str, argument: str) -> None:
        self._enabled[register] = round(setting(argument, 0, _REGISTER_MOST))

    def _status_byte(self) -> int:
        status = self._summary() | (ERROR_AVAILABLE if self._errors else 0)
        if self._events & self._enabled["ESE"]:
            status |= EVENT_SUMMARY
        return status | (MASTER_SUMMARY if status & self._enabled["SRE"] else 0)

    def _handler(self, header: str) -> Handler:
        handler = self._handlers.get(header)
        if handler is None:
            raise Refusal(UNDEFINED_HEADER)
        return handler

    def _clear(self, _: str) -> None:
        self._errors.clear()
        self._events = 0

    def _complete(self, _: str) -> None:
        self._events |= 1

    def _take_events(self, _: str) -> str:
        events, self._events = self._events, 0
        return str(events)

    def _take_error(self, _: str) -> str:
        entry = self._errors.popleft() if self._errors else EMPTY
        return f"+{entry}" if self._signed and entry.code >= 0 else str(entry)


class ScpiInstrument:
    """Common part of simulated SCPI instruments: settings that are executed, delayed or stuck, and lost with power."""

    faults: FaultPlan
    _interpreter: Interpreter

    def restart(self) -> None:
        """Short power failure: all settings are as at power-on."""
        self._reset()
        self._interpreter.power_on()

    def unless_stuck(self, handler: Handler) -> Handler:
        """Execute a setting, unless it is stuck or delayed."""
        return lambda argument: self.faults.carry_out(lambda: handler(argument), Refusal)

    def _reset(self) -> None:
        """Give all settings their values at power-on."""
        raise NotImplementedError


class LineSession:
    """One connection to an instrument with a line protocol.

    A line ends at `end`; spaces and other line ends around it are dropped. Answers end with `answer_end`.
    """

    def __init__(self, execute: Callable[[str], str], *, end: bytes = b"\n", answer_end: bytes = b"\n") -> None:
        self._execute, self._end, self._answer_end = execute, end, answer_end
        self._rest = b""

    def feed(self, data: bytes) -> bytes:
        """Receive bytes in any portions; return the answers to completed lines."""
        *lines, self._rest = (self._rest + data).split(self._end)
        if len(self._rest) > LINE_LIMIT_BYTES:
            self._rest = b""
        answers = [self._execute(line.decode("latin-1").strip()) for line in lines]
        return b"".join(answer.encode("latin-1") + self._answer_end for answer in answers if answer)


def setting(argument: str, low: float, high: float) -> float:
    """Parse a number from `low` to `high`, or MIN or MAX; raises Refusal as an instrument would."""
    if argument.upper() in _ENDS:
        return (low, high)[_ENDS[argument.upper()]]
    try:
        value = scpi.number(argument)
    except ValueError:
        raise Refusal(WRONG_TYPE) from None
    if not low <= value <= high:
        raise Refusal(OUT_OF_RANGE)
    return value


def asked(which: str, set_to: float, low: float, high: float) -> float:
    """Number that a query asks for: the setting, or with MIN or MAX a limit of it; raises Refusal."""
    if which.upper() not in ("", "MIN", "MAX"):
        raise Refusal(NOT_ALLOWED)
    return {"MIN": low, "MAX": high}.get(which.upper(), set_to)


_ENDS = {"MIN": 0, "MINIMUM": 0, "MAX": 1, "MAXIMUM": 1}  # of a range
_SWITCH = {"1": True, "ON": True, "0": False, "OFF": False}


def switch(argument: str) -> bool:
    """Parse a switch argument: 1, 0, ON or OFF; raises Refusal."""
    value = _SWITCH.get(re.sub(r"\.0*$", "", argument.upper()))
    if value is None:
        raise Refusal(ILLEGAL_VALUE)
    return value
