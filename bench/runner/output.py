"""Output that may be lost: a terminal that is closed, hangs, or is held by Ctrl-S does not delay the run.

Standard error is written by a thread, so that a run never waits for its reader. An error of a stream ends its output,
and nothing else.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

KEPT_CHARACTERS = 1_000_000  # limit of text waiting for a terminal; older text is dropped
AT_THE_END_S = 2.0  # time for the remaining text when the run is over


class TolerantStream(io.TextIOBase):
    """Stream wrapper that drops all text after the first error of the stream, and raises nothing."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.is_gone = False

    def write(self, text: str, /) -> int:
        """Write text to the stream."""
        if not self.is_gone:
            try:
                self._stream.write(text)
                self._stream.flush()
            except (OSError, ValueError):  # the stream is gone or closed
                self.is_gone = True
        return len(text)

    def flush(self) -> None:
        """Do nothing, since nothing is buffered."""

    def isatty(self) -> bool:
        """Return True if the stream is a terminal."""
        with contextlib.suppress(OSError, ValueError):
            return not self.is_gone and self._stream.isatty()
        return False

    def fileno(self) -> int:
        """Return the descriptor of the stream."""
        return self._stream.fileno()

    @property
    def encoding(self) -> str:  # type: ignore[override]  # a plain attribute of io.TextIOBase
        """Encoding of the stream."""
        return self._stream.encoding


class ThreadedStream(TolerantStream):
    """Stream wrapper that writes in a thread, so that a blocked stream delays nobody."""

    def __init__(self, stream: TextIO) -> None:
        super().__init__(stream)
        self._descriptor = stream.fileno()
        self._texts: deque[str] = deque()
        self._waiting = 0
        self._changed = threading.Condition()
        threading.Thread(target=self._write_for_ever, name="output", daemon=True).start()

    def write(self, text: str, /) -> int:
        """Queue text for writing."""
        with self._changed:
            self._texts.append(text)
            self._waiting += len(text)
            while self._waiting > KEPT_CHARACTERS and len(self._texts) > 1:
                self._waiting -= len(self._texts.popleft())
            self._changed.notify_all()
        return len(text)

    def finish(self) -> None:
        """Wait until all text is written, or the stream has not taken any for a while."""
        with self._changed:
            self._changed.wait_for(lambda: not self._waiting or self.is_gone, AT_THE_END_S)

    def _write_for_ever(self) -> None:
        """Write to the descriptor, past the stream, whose lock would be held while it is blocked."""
        while not self.is_gone:
            with self._changed:
                self._changed.wait_for(lambda: self._texts)
                texts, self._texts = "".join(self._texts), deque()
            left = texts.encode(self.encoding, "replace")
            try:
                while left:
                    left = left[os.write(self._descriptor, left) :]
            except OSError:
                self.is_gone = True
            with self._changed:
                self._waiting = sum(map(len, self._texts))
                self._changed.notify_all()


@contextmanager
def tolerant_output() -> Iterator[None]:
    """Protect standard output and error in the block; a stream that fails stays silent until the process ends."""
    out, error = sys.stdout, sys.stderr
    error.flush()
    lasting = TolerantStream(out)
    try:
        unhurried: TolerantStream = ThreadedStream(error)
    except (OSError, ValueError):  # it has no descriptor
        unhurried = TolerantStream(error)
    sys.stdout, sys.stderr = lasting, unhurried
    try:
        yield
    finally:
        if isinstance(unhurried, ThreadedStream):
            unhurried.finish()
        if not lasting.is_gone:
            sys.stdout = out
        if not unhurried.is_gone:
            sys.stderr = error
