"""A connection to a simulated scanner: a query of a scan is answered at its end."""

from __future__ import annotations

import math
from collections import deque
from typing import Protocol

from drivers.protocols import scpi
from drivers.protocols.scpi import Command
from simulators.serving.serve import DelayedAnswers

_WAITING = ("*OPC?", "*WAI")
_FETCH = ("FETCH?", "FETC?")
_READ = "READ?"
_MEASURE_VOLTS = ("MEAS:VOLT:DC?", "MEASURE:VOLTAGE:DC?", "MEAS:VOLT?", "MEASURE:VOLTAGE?")
_MEASURE = ("MEAS:TEMP?", "MEASURE:TEMP?", "MEAS:TEMPERATURE?", "MEASURE:TEMPERATURE?")


class Scanner(Protocol):
    """Interface of a scanner for its sessions."""

    answer_end: bytes

    def carry_out(self, command: Command) -> str | None:
        """Execute a command that does not wait for a scan; return its answer."""

    def joined(self, answers: list[str]) -> str:
        """Join the answers to one line."""

    def begin_scan(self, *, kept: bool = True) -> float | None:
        """Begin a scan; return its duration (s), None if none begins."""

    def begin_measurement(self, argument: str, *, volts: bool) -> float | None:
        """Configure channels, for DC volts or a temperature, and begin a scan of them; as `begin_scan`."""

    def left_s(self) -> float:
        """Remaining time of the running scan (s)."""

    def end_scan(self) -> str:
        """Readings of the finished scan, "" without one."""


class ScannerSession(DelayedAnswers):
    """A connection: a command that waits for a scan delays all later ones. Lines end with LF or CR LF.

    READ?, MEAS:TEMP?, FETC?, *OPC? and *WAI wait; all others are executed during a scan.
    """

    def __init__(self, scanner: Scanner) -> None:
        self._scanner = scanner
        self._rest = b""
        self._lines: deque[_Line] = deque()
        self._waits = False

    def feed(self, data: bytes) -> bytes:
        """Receive bytes in any portions; return the immediate answers."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._lines.extend(_Line(line.decode("latin-1").strip()) for line in lines)
        return self._next_replies()

    def _next_replies(self) -> bytes:
        sent = b""
        while self._lines and not self._waits:
            line = self._lines[0]
            if not line.commands:
                self._lines.popleft()
                sent += self._reply(self._scanner.joined(line.answers))
            else:
                self._next_of(line)
        return sent

    def _next_of(self, line: _Line) -> None:
        """Execute the next command of a line, or wait for its scan."""
        command = line.commands[0]
        if command.header in (_READ, *_MEASURE, *_MEASURE_VOLTS) and not line.reads:
            if self._begun(command) is None:
                line.commands.popleft()
                return
            line.reads = True
        if (line.reads or command.header in (*_WAITING, *_FETCH)) and (left_s := self._scanner.left_s()):
            endless = math.isinf(left_s)
            if not (endless and command.header in _FETCH):  # memory can be read during a scan that does not end
                self._waits = True
                if not endless:
                    self._later(left_s, self._go_on)
                return
        line.commands.popleft()
        answer = self._answer(command, reads=line.reads)
        line.reads = False
        if answer:
            line.answers.append(answer)

    def _begun(self, command: Command) -> float | None:
        if command.header == _READ:
            return self._scanner.begin_scan(kept=False)
        return self._scanner.begin_measurement(command.argument, volts=command.header in _MEASURE_VOLTS)

    def _answer(self, command: Command, *, reads: bool) -> str | None:
        """Answer once there is nothing more to wait for."""
        if reads:
            return self._scanner.end_scan()
        if command.header in _FETCH:
            return self._scanner.end_scan() or self._scanner.carry_out(command)
        return self._scanner.carry_out(command)

    def _go_on(self) -> bytes:
        self._waits = False
        return self._next_replies()

    def _reply(self, answer: str) -> bytes:
        return answer.encode() + self._scanner.answer_end if answer else b""


class _Line:
    """A line in execution: remaining commands, and answers so far."""

    def __init__(self, text: str) -> None:
        self.commands = deque(scpi.commands(text))
        self.answers: list[str] = []
        self.reads = False  # the scan of the READ? or MEAS? at its front is running
