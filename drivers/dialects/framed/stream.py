"""One connection over which a controller sends status frames."""

from __future__ import annotations

import asyncio
import math

from drivers.dialects.framed.status import StatusReader
from drivers.dialects.framed.wire import FrameFormat, Raw, Splitter
from drivers.errors import Refused
from drivers.transport.stream_end import StreamEnd

SPLICE_S = 0.05  # the rest of a frame that has not arrived by then is lost


class StatusStream(StreamEnd):
    """Receives status frames: the expected one is `fresh`, others are `unsolicited`; `expect` resets both.

    A status with the counter of the last one is neither, because it has nothing new: `repeated` counts those, `missing`
    the lost ones by the counter. An incomplete frame is dropped after `rest_s`, so that two halves make no frame.
    Concurrency: one caller at a time waits for bytes.
    """

    def __init__(self, device: str, status: FrameFormat, reader: StatusReader, rest_s: float) -> None:
        super().__init__()
        self._device, self._reader, self._rest_s = device, reader, max(rest_s, SPLICE_S)
        self._splitter = Splitter([status])
        self._counter: Raw | None = None
        self._expecting = False
        self._answers: Raw | None = None
        self.fresh: bytes | None = None
        self.unsolicited = self.repeated = self.missing = 0
        self._received_at_s = -math.inf

    def expect(self, answers: Raw | None = None) -> None:
        """Take the next status as fresh, or the next that answers a request with this counter."""
        self._expecting, self._answers, self.fresh = True, answers, None

    async def expected(self) -> bytes:
        """Return the fresh status; ConnectionError if the connection closes, Refused after `interrupt`."""
        try:
            while self.fresh is None:
                await self.more()
            return self.fresh
        finally:
            self._expecting = False

    @property
    def dropped(self) -> int:
        """Number of bytes that belonged to no frame."""
        return self._splitter.dropped

    @property
    def last_dropped(self) -> bytes:
        """Last bytes that belonged to no frame."""
        return self._splitter.last_dropped

    def send(self, frame: bytes) -> None:
        """Send a frame; ConnectionError when the connection is closed."""
        if self._transport is None or self.lost:
            raise self._loss()
        self._transport.write(frame)

    def interrupt(self) -> None:
        """End a wait for bytes: it raises Refused."""
        self._end_wait(Refused(self._device, "aborted, the instrument is being made safe"))

    def forget(self) -> None:
        """Drop received frames that were not expected."""
        self.unsolicited = 0
        self._splitter.forget()

    def close(self, why: str = "the connection was closed by this program") -> None:
        """Close the connection; closing twice is harmless."""
        self.lost = self.lost or why
        if self._transport is not None:
            self._transport.close()

    def _take(self, frame: bytes) -> None:
        counter, last = self._reader.counter(frame), self._counter
        if counter is not None and counter == last:
            self.repeated += 1
            return
        if counter is not None and last is not None:
            self.missing += int(counter - last - 1) % self._reader.counter_range
        self._counter = counter
        if self._expecting and self._answers in (None, self._reader.answers(frame)):
            self.fresh, self._expecting = frame, False
        else:
            self.unsolicited += 1

    def data_received(self, data: bytes) -> None:
        """Receive bytes of the controller."""
        now_s = asyncio.get_running_loop().time()
        if self._splitter.unfinished and now_s - self._received_at_s > self._rest_s:
            self._splitter.forget()
        self._received_at_s = now_s
        for _, frame in self._splitter.feed(data):
            self._take(frame)
        super().data_received(data)
