"""Line to a controller with a frame protocol: fresh status frames, and commands that are sent once.

A status read after a command reflects that command: frames received before the `reaction` time of the profile has
passed are ignored. After a timeout, which a late answer may follow, and after an unsolicited status, the line is out of
sync: received frames are discarded until it has been silent for as long as an answer may take.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from typing import Any

from drivers.description import Setup
from drivers.dialects.framed.profile import FrameProfile
from drivers.dialects.framed.status import Status, StatusReader
from drivers.dialects.framed.stream import StatusStream
from drivers.dialects.framed.wire import NumberFormat, Raw
from drivers.errors import BadAnswer, LinkLost, NoAnswer, Refused
from drivers.timing.awake import fair_timeout, now_s
from drivers.transport.dialogue import ReconnectBackoff, retry_once
from drivers.transport.exchange import printable_hex

DRAIN_LIMIT_S = 5.0
SILENT_PERIODS = 5  # lower limit of the timeout of a cyclic controller
REPORT_INTERVAL_S = 60.0
MAX_TIMEOUTS = 2  # after so many timeouts a network connection is closed: it may be open at one end only

Numbers = Iterable[tuple[NumberFormat, Raw]]


class FramedLine:
    """Successive lines to the same controller.

    Reading the status retries once without an answer, and reconnects after a loss: at once, then after increasing
    pauses; a command does neither. `check` gets the first status of every connection, and raises if it is another
    controller's. `setup.note` receives repeated reads, dropped and missing frames, once a minute at most, and the loss
    and return of the connection.

    Lifetime: `open`, then `close`; `reopen` when the wire was lost. Concurrency: callers queue.
    """

    def __init__(
        self, setup: Setup[Any, Any, Any], profile: FrameProfile, *, answer_s: float, check: Callable[[Status], None]
    ) -> None:
        self._device, self._wires, self._note, self._profile = setup.name, setup.wires, setup.note, profile
        address = setup.address
        self._at_a_port = address.scheme == "serial"
        as_stated = profile.line.options() | dict(address.options)
        self._address = replace(address, options=as_stated) if self._at_a_port else address
        self._check = check
        self._period_s = profile.cyclic.period if profile.cyclic is not None else 0.0
        self._answer_s = max(answer_s, SILENT_PERIODS * self._period_s)
        self._reader = StatusReader(profile)
        self._turn = asyncio.Lock()
        self._stream: StatusStream | None = None
        self._out_of_sync = False
        self._number = self._preemptions = self._timeouts = 0
        self._sent_at_s = self._reported_at_s = -math.inf
        self._backoff, self._closed = ReconnectBackoff(), False
        self._reported = (0, 0)

    async def open(self) -> None:
        """Connect and identify; raises CannotConnect, NoAnswer, and what `check` raises."""
        async with self._turn:
            await retry_once(self._connect, self._note)

    async def reopen(self) -> None:
        """Reconnect at once if the connection was lost; else do nothing."""
        if self._is_open:
            return
        async with self._turn:
            if not self._is_open:
                await self._connect()

    @property
    def _is_open(self) -> bool:
        return self._stream is not None and not self._stream.lost

    def close(self) -> None:
        """Close the wire; closing twice is harmless."""
        self._closed = True
        if self._stream is not None:
            self._stream.close()

    async def status(self) -> Status:
        """Status after the last command; on a new connection if the old one was lost.

        Raises NoAnswer, BadAnswer, LinkLost, Refused if preempted, and errors of connecting.
        """
        async with self._turn:
            if self._stream is not None and self._stream.lost:
                await self._reconnect()
            stream = self._opened()
            return await retry_once(lambda: self._read_status(stream), self._note)

    async def send_command(self, name: str, numbers: Numbers = ()) -> None:
        """Send a command once; its effect is in the status. Raises LinkLost, and Refused if it was not sent.

        If commands are acknowledged, it returns after the acknowledgement or its timeout.
        """
        preemptions, frame = self._preemptions, self._frame(name, numbers)
        async with self._turn:
            stream = self._opened()
            if self._profile.commands_answered:
                await self._drain_if_out_of_sync(stream)
            await self._leave_gap()
            if self._preemptions != preemptions:
                raise Refused(self._device, "not sent, the instrument is being made safe", sent=_spelled(name, frame))
            self._send(stream, name, frame)
            if self._profile.commands_answered:
                stream.expect()
                with suppress(NoAnswer):
                    await self._expected(stream, _spelled(name, frame))

    def preempt(self, name: str) -> None:
        """Send a command that makes the instrument safe, ahead of everything queued; raises LinkLost.

        A pending status read ends with Refused, and queued commands are not sent any more.
        """
        self._preemptions += 1
        self._out_of_sync = True
        stream = self._opened()
        self._send(stream, name, self._frame(name, ()))
        stream.interrupt()

    def _frame(self, name: str, numbers: Numbers) -> bytes:
        """Build a frame with the next sequence number, if it has a field for one."""
        shape = self._profile.shape(name)
        if shape.counter is not None:
            form = self._profile.number(shape.counter)
            self._number = (self._number + 1) % (1 << 8 * shape.counter.count)
            numbers = [*numbers, (form, self._number)]
        return self._profile.format(name).build(numbers)

    async def _read_status(self, stream: StatusStream) -> Status:
        """Read the next status, requested if the controller needs a request."""
        await self._drain_if_out_of_sync(stream)
        while (early_s := self._sent_at_s + self._profile.reaction - now_s()) > 0:  # noqa: ASYNC110 - preempt moves it
            await asyncio.sleep(early_s)
        frame = b""
        if self._profile.request is not None:
            await self._leave_gap()
            frame = self._frame("request", ())
            echoed = self._profile.status.answers is not None
            stream.expect(self._number if echoed else None)
            self._write(stream, "request", frame)
        else:
            stream.expect()
        found = await self._expected(stream, _spelled("request", frame) if frame else "")
        self._timeouts = 0
        self._report_losses(stream)
        try:
            return self._reader.read(found)
        except ValueError as problem:
            raise BadAnswer(
                self._device, f"a status with an invalid number: {problem}", received=printable_hex(found),
                remedy="Look at the controller for a fault of its encoder, and at the types in the profile.",
            ) from problem  # fmt: skip

    async def _expected(self, stream: StatusStream, sent: str) -> bytes:
        dropped, repeated = stream.dropped, stream.repeated
        self._out_of_sync = True  # until it arrives
        try:
            async with fair_timeout(self._answer_s):
                found = await stream.expected()
        except TimeoutError:
            self._timeouts += 1
            if self._timeouts >= MAX_TIMEOUTS and not self._at_a_port:
                stream.close("no more answers")
            raise self._no_answer(stream, sent, dropped, repeated) from None
        except ConnectionError as problem:
            raise LinkLost(self._device, str(problem), sent=sent) from problem
        self._out_of_sync = False
        return found

    async def _drain_if_out_of_sync(self, stream: StatusStream) -> None:
        """Drain a line that answers requests, if a late answer is possible."""
        if self._profile.cyclic is not None or not (self._out_of_sync or stream.unsolicited):
            return
        deadline_s = now_s() + DRAIN_LIMIT_S
        while True:
            stream.forget()
            try:
                async with fair_timeout(self._answer_s):
                    await stream.more()
            except TimeoutError:
                self._out_of_sync = False
                return
            except ConnectionError as problem:
                raise LinkLost(self._device, str(problem)) from problem
            if now_s() > deadline_s:
                raise BadAnswer(
                    self._device, f"is not silent within {DRAIN_LIMIT_S:g} s",
                    remedy="Check whether it sends its status by itself: its profile then says cyclic, not request.",
                )  # fmt: skip

    async def _leave_gap(self) -> None:
        early_s = self._sent_at_s + self._profile.gap - now_s()
        if early_s > 0:
            await asyncio.sleep(early_s)

    def _send(self, stream: StatusStream, name: str, frame: bytes) -> None:
        """Send a command, after which a status may still be an old one."""
        self._write(stream, name, frame)
        self._sent_at_s = now_s()

    def _write(self, stream: StatusStream, name: str, frame: bytes) -> None:
        try:
            stream.send(frame)
        except ConnectionError as problem:
            raise LinkLost(self._device, str(problem), sent=_spelled(name, frame)) from problem

    # Connection

    async def _connect(self) -> None:
        self._closed, why = False, ""
        if self._stream is not None:
            self._stream.close()
            why = self._stream.lost
        try:
            self._stream = await self._wires.stream(self._device, self._address, self._new_stream)
            self._out_of_sync, self._timeouts, self._reported = self._address.is_serial_line, 0, (0, 0)
            self._sent_at_s = now_s()  # a serial server may hold earlier data
            self._check(await self._read_status(self._stream))
        except BaseException:
            if self._stream is not None:
                self._stream.close()
            self._backoff.failed()
            raise
        self._backoff = ReconnectBackoff()
        if why:
            self._note(f"connected and identified again at {self._address}: {why}")

    async def _reconnect(self) -> None:
        """Reconnect, unless the pause is not over."""
        if self._closed:
            raise LinkLost(self._device, "is not connected")
        if (wait_s := self._backoff.left_s()) > 0:
            raise LinkLost(self._device, f"is not connected; the next attempt is in {wait_s:.1f} s")
        await self._connect()

    def _new_stream(self) -> StatusStream:
        return StatusStream(self._device, self._profile.format("status"), self._reader, self._period_s)

    def _opened(self) -> StatusStream:
        if self._stream is None:
            raise LinkLost(self._device, "is not connected")
        return self._stream

    # Sending

    def _no_answer(self, stream: StatusStream, sent: str, dropped: int, repeated: int) -> NoAnswer:
        problem, received = f"no status within {self._answer_s:g} s", ""
        remedy = "Check that the controller is on, the cable, and the settings of the line."
        if stream.repeated > repeated:
            problem = f"only repetitions of the same status for {self._answer_s:g} s"
            remedy = "Check the controller: its status is not updated."
        elif stream.dropped > dropped:
            received = f"{stream.dropped - dropped} bytes that belong to no frame, {printable_hex(stream.last_dropped)}"
            remedy = "Check the settings of the line, and header, length and checksum in the profile."
        return NoAnswer(self._device, problem, sent=sent, received=received, remedy=remedy)

    def _report_losses(self, stream: StatusStream) -> None:
        """Note lost frames, if there are more and the last note is old enough."""
        missing = stream.missing if self._profile.cyclic is not None else 0
        found = (stream.dropped, missing)
        if found != self._reported and now_s() >= self._reported_at_s + REPORT_INTERVAL_S:
            self._reported, self._reported_at_s = found, now_s()
            self._note(
                f"since the connection {stream.dropped} bytes belonged to no frame"
                + (f", the last {printable_hex(stream.last_dropped)}" if stream.dropped else "")
                + (f"; {missing} statuses were lost" if missing else "")
            )


def _spelled(name: str, frame: bytes) -> str:
    return f"{name} {printable_hex(frame)}"
