"""An instrument that replays its part of a trace."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial

from drivers.transport.trace import CLOSED, OPENED, RECEIVED, SENT, Passed
from simulators.faults.instrument_faults import FaultPlan
from simulators.serving.serve import Later


class ReplayedInstrument:
    """One device of a trace as a simulated instrument: each new connection replays the next one of the trace.

    The next request of the trace gets the recorded answers, with their recorded delays. Any other request is passed to
    `report_mismatch` and not answered: then the driver, or its settings, differ from the recording.
    """

    def __init__(self, device: str, trace: Iterable[Passed], report_mismatch: Callable[[str], object]) -> None:
        self.faults = FaultPlan()
        self._device, self._report_mismatch = device, report_mismatch
        self._connections: list[list[Passed]] = []
        for passed in trace:
            if passed.device != device:
                continue
            if passed.sign == OPENED:
                self._connections.append([])
            elif passed.sign != CLOSED and self._connections:
                self._connections[-1].append(passed)

    def session(self) -> ReplayedSession:
        """Open the next connection of the trace; an empty one after the last."""
        lines = self._connections.pop(0) if self._connections else []
        return ReplayedSession(self._device, lines, self._report_mismatch)


class ReplayedSession:
    """One connection of a trace."""

    def __init__(self, device: str, lines: list[Passed], report_mismatch: Callable[[str], object]) -> None:
        self._device, self._lines, self._report_mismatch = device, lines, report_mismatch
        self._received = b""
        self._later: Later | None = None

    def answer_by(self, later: Later) -> None:
        """Set the callback for later answers."""
        self._later = later

    def feed(self, data: bytes) -> bytes:
        """Receive bytes in any portions; return the immediate answer of the recording."""
        self._received += data
        at_once = b""
        while self._lines and self._received:
            expected = self._lines[0]
            if expected.sign != SENT or not self._received.startswith(expected.data):
                if expected.sign == SENT and expected.data.startswith(self._received):
                    return at_once  # start time of the connection
                break
            self._lines.pop(0)
            self._received = self._received[len(expected.data) :]
            at_once += self._answers(expected.at_s)
        if self._received:
            wanted = self._lines[0].text if self._lines else "nothing more"
            self._report_mismatch(f"{self._device}: the trace has {wanted}, not {self._received.hex(' ')}")
            self._received = b""
        return at_once

    def _answers(self, asked_s: float) -> bytes:
        """The immediate answers to a request; later ones are sent later."""
        at_once = b""
        while self._lines and self._lines[0].sign == RECEIVED:
            answer = self._lines.pop(0)
            if self._later is None or answer.at_s <= asked_s:
                at_once += answer.data
            else:
                self._later(answer.at_s - asked_s, partial(bytes, answer.data))
        return at_once
