"""Log of a station: one JSON object on one line for each event, in UTC, without secrets."""

from __future__ import annotations

import logging
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO

import structlog

from bench.station.part import Part
from bench.station.queue.items import Item

if TYPE_CHECKING:
    from bench.station.runs.live import Live

Log = Any  # a logger of structlog has a method for each level, whatever its class
LETTERS = 2000  # of a value


def make_log(stream: TextIO) -> Log:
    """Return the log that writes to a stream. Everything but printable ASCII is escaped, as JSON allows."""
    return structlog.wrap_logger(
        structlog.WriteLogger(stream),
        processors=[
            _cut, structlog.processors.add_log_level, structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.JSONRenderer(ensure_ascii=True),
        ],
        wrapper_class=structlog.make_filtering_bound_logger(logging.INFO), cache_logger_on_first_use=False,
    )  # fmt: skip


def _cut(_log: object, _level: str, event: Any) -> Any:
    return {key: value[:LETTERS] if isinstance(value, str) else value for key, value in event.items()}


class _Forwarding(logging.Handler):
    """Handler that passes the warnings of libraries to the log, with their tracebacks on the same line."""

    def __init__(self, log: Log) -> None:
        super().__init__(logging.WARNING)
        self._log = log

    def emit(self, record: logging.LogRecord) -> None:
        """Log a message of a library."""
        trace = "".join(traceback.format_exception(*record.exc_info))[-LETTERS:] if record.exc_info else ""
        self._log.warning("library", library=record.name, message=record.getMessage(), traceback=trace)


@contextmanager
def libraries_in(log: Log) -> Iterator[None]:
    """Pass the warnings of libraries to the log in the block."""
    handler = _Forwarding(log)
    logging.getLogger().addHandler(handler)
    try:
        yield
    finally:
        logging.getLogger().removeHandler(handler)


class Changes(Part):
    """Log of what changes at a station: problems of its parts, items of the queue, runs in progress."""

    every_s = 1.0

    def __init__(self, log: Log, parts: Mapping[str, Part], live: Live) -> None:
        super().__init__()
        self._log, self._parts, self._live = log, parts, live
        self._problems: dict[str, str] = {}
        self._running: set[str] = set()

    async def look(self) -> None:
        """Log the changes since the last look."""
        for name, part in self._parts.items():
            if part.problem != self._problems.get(name, ""):
                self._log.warning("part", part=name, problem=part.problem)
            self._problems[name] = part.problem
        running = set(self._live.runs)
        for run in sorted(running - self._running):
            self._log.info("run begins", run=run)
        for run in sorted(self._running - running):
            self._log.info("run has ended", run=run)
        self._running = running

    def item(self, item: Item) -> None:
        """Log a change of an item."""
        self._log.info(
            "item", number=item.number, id=item.id, state=item.state, bench=item.submission.bench, title=item.title,
            run=item.run, verdict=item.verdict, reason=item.reason,
        )  # fmt: skip
