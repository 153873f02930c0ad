"""Writing of a run: one thread writes all data to one SQLite file, in the order given."""

from __future__ import annotations

import asyncio
import json
import math
import queue
import sqlite3
import threading
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache, partial
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar

from bench.clock import Stopwatch
from bench.errors import StoreError
from bench.loop import expect, give
from bench.quality import Valid
from bench.store import database, ledger
from bench.store.blocks import Content, content_of, packed
from bench.store.chain import NOTHING, Link, beginning
from bench.store.digest import Digest
from bench.store.encoded import Row, encoded
from bench.store.place import WatchedFiles, rescue, rescue_database
from bench.store.runs import MANIFEST
from drivers.can.frame_block import FrameBlock
from drivers.timing.awake import succeeded_within

T = TypeVar("T")

LEDGER_EVERY_S = 60.0  # real time; truncation of an interrupted run before the first entry goes unnoticed
GROUP_S = 1.0  # real time after which data are durable at the latest
WAITING_LIMIT = 50_000  # rows that wait for the disk; more means that the disk is too slow
SLOW_DISK_S = 30.0

_ENCODER = json.JSONEncoder(ensure_ascii=False, sort_keys=True, allow_nan=False)
ROWS_AT_ONCE = 100  # rows per statement: batches release the GIL less often
Rows = defaultdict[str, list[Row]]
"""Rows of a transaction, of the tables that have any."""


class RunWriter:
    """Writer of a run. All methods but `commit` return at once; `commit` returns when all data given are durable.

    With `resumed` it continues an interrupted run; without `noted` it writes no entries in the ledger. Lifetime: from
    the creation of the directory to `close`. Concurrency: called from the thread of the event loop; one thread of its
    own owns the database. After a failed write nothing is acknowledged: every later call raises StoreError, and
    `on_failure` is called with it in the writer thread. The directory is checked every second: moving or removing it,
    or truncating the database, is a failure, and `folder` is then the location of the record.
    """

    def __init__(self, folder: Path, *, resumed: bool = False, noted: bool = True) -> None:
        self.folder = folder
        self._channels: dict[str, int] = {}
        self._database = (database.reopen if resumed else database.create)(folder / database.FILE_NAME)
        self._link = Link(0, NOTHING, beginning(folder / MANIFEST))
        self._beginning = self._link.head
        try:
            if resumed:
                self._go_on()
            else:
                self._insert({database.CHAIN: [self._link.to_row()]})
        except (sqlite3.Error, ValueError) as problem:
            self._database.close()
            raise StoreError(f"{folder}: the run store cannot write ({problem})") from problem
        self._place = WatchedFiles(folder, (database.FILE_NAME, database.LOG_NAME))
        self._place.lost()  # initialise the size to compare with
        self.on_failure: Callable[[StoreError], object] = lambda _: None
        self._is_noted = noted
        self._noted: Stopwatch | None = None
        self.ledger_problem = ""
        self._digest = None if resumed else Digest()
        self._lock = threading.RLock()
        self._room = threading.Condition(self._lock)
        self._calls: queue.SimpleQueue[None] = queue.SimpleQueue()  # each wakes the thread
        self._rows: Rows = defaultdict(list)
        self._waiting = 0
        self._tickets: list[asyncio.Future[None]] = []
        self._in_hand: list[asyncio.Future[None]] = []  # tickets taken by the thread
        self._closing = False
        self._commits, self._is_writing = 0, False
        self._failure: StoreError | None = None
        self._numbers = dict(self._link.rows)
        self._thread = threading.Thread(target=self._write_for_ever, name="run store", daemon=True)
        self._thread.start()

    def event(self, kind: str, step: str = "", **data: Any) -> None:
        """Append an entry to the journal at the present bench time; equal for equal runs."""
        at_s = float(asyncio.get_running_loop().time())  # a NumPy float has another text, and so another link
        text = _ENCODER.encode(data) if data else "{}"
        self._put("journal", (at_s, kind, step, text))

    def frames(self, stream: str, step: str, block: FrameBlock) -> None:
        """Append raw frames of a device during a step."""
        self._put("block", (stream, step, block))

    def samples(self, stream: str, step: str, readings: Sequence[Valid]) -> None:
        """Append samples of a device during an acquisition. Raises StoreError for NaN and infinity."""
        _check_finite(stream, readings)
        self._put("sample", *((float(at_s), stream, step, float(value)) for at_s, value, _ in readings))

    def readings(self, name: str, unit: str, readings: Sequence[Valid]) -> None:
        """Append readings of one channel. Raises StoreError for NaN and infinity."""
        _check_finite(name, readings)
        channel = self._channels.get(name)
        if channel is None:
            channel = self._channels[name] = len(self._channels) + 1
            self._put("channel", (name, unit))
        self._put("reading", *((at_s, channel, value) for at_s, value, _ in readings))

    async def commit(self) -> None:
        """Wait until all data given so far are on the disk. Raises StoreError if that fails."""
        with self._lock:
            self._raise_failure()
            ticket: asyncio.Future[None] = expect()
            self._tickets.append(ticket)
        self._calls.put(None)
        await ticket

    def close(self) -> None:
        """Write the remaining data and close the file. Raises StoreError if that fails; closing twice is harmless."""
        with self._lock:
            self._closing = True
        self._calls.put(None)
        self._thread.join()
        self._raise_failure()

    @property
    def commits(self) -> tuple[int, bool]:
        """Return the number of commits, and whether data are waiting for the disk."""
        return self._commits, self._is_writing or bool(self._tickets)

    @property
    def beginning(self) -> bytes:
        """Head of link 0: hash of the manifest at the beginning of the run."""
        return self._beginning

    @property
    def link(self) -> Link:
        """Return the last link of the chain; valid after `close`."""
        return self._link

    def digest(self) -> str:
        """Return the digest of all data written, equal to that of a reader; valid after `close`. Raises StoreError.

        Empty for a resumed run, whose earlier rows only a reader has.
        """
        self._raise_failure()
        return "" if self._digest is None else self._digest.hexdigest()

    def _go_on(self) -> None:
        """Continue the chain and the row numbers of earlier commits. Raises ValueError for a broken chain."""
        first, last = (
            Link.from_row(self._database.execute(f"SELECT * FROM {database.CHAIN} ORDER BY {order}").fetchone())  # noqa: S608
            for order in ("number", "number DESC")
        )
        if first.head != self._beginning:
            raise ValueError("the manifest is not the one that the run began with")
        self._link = last
        self._channels = dict(self._database.execute("SELECT name, id FROM channel"))

    def _put(self, table: str, *rows: tuple[Any, ...]) -> None:
        with self._lock:
            self._raise_failure()
            if not rows:
                return
            if self._waiting > WAITING_LIMIT:
                self._calls.put(None)
                if not succeeded_within(partial(self._room.wait_for, self._has_room), SLOW_DISK_S):
                    raise StoreError(f"the disk has accepted no data for {SLOW_DISK_S:g} s; is it failing or full?")
            first = self._numbers[table] + 1
            self._rows[table] += [(number, *row) for number, row in enumerate(rows, start=first)]
            self._numbers[table] += len(rows)
            self._waiting += len(rows)
        if table == "block":
            self._calls.put(None)

    def _raise_failure(self) -> None:
        if self._failure is not None:
            raise StoreError(str(self._failure))

    # Methods of the writer thread

    def _write_for_ever(self) -> None:
        """Run the thread, and answer waiting callers whatever ends it."""
        try:
            self._write_until_closed()
        except BaseException as problem:  # noqa: BLE001  such as MemoryError between two writes
            with self._lock:
                self._failure = self._failure or StoreError(f"the run store has stopped ({problem!r})")
                tickets, self._tickets, self._waiting = [*self._in_hand, *self._tickets], [], 0
                self._room.notify_all()
            self._answer(tickets)
        self._close_database()

    def _write_until_closed(self) -> None:
        """Pack blocks as they arrive, so that a commit waits for the last block only."""
        closing, group = False, _Group()
        while not closing:
            with suppress(queue.Empty):
                self._calls.get(timeout=group.due_in_s)
            with self._lock:
                rows, self._rows, self._waiting = self._rows, defaultdict(list), 0
                tickets, self._tickets = self._tickets, []
                self._in_hand = tickets
                closing = self._closing
                self._room.notify_all()
            self._try(group.take, rows)
            if tickets or closing or not group.due_in_s:
                self._write(group, tickets)
                group = _Group()

    def _has_room(self) -> bool:
        return self._waiting <= WAITING_LIMIT

    def _write(self, group: _Group, tickets: Sequence[asyncio.Future[None]]) -> None:
        """Write one transaction; answer its tickets when it is durable, or with the failure."""
        self._is_writing = True
        lost = self._place.lost()
        if lost is not None and lost.is_truncated:  # SQLite would extend the file again
            self._try(self._rescue_truncated, lost.path)
        if group.rows:
            self._try(self._append, group)
            self._note()
        if lost is not None:
            self._try(self._follow, lost.path)
        self._commits, self._is_writing = self._commits + 1, False
        self._answer(tickets)

    def _answer(self, tickets: Sequence[asyncio.Future[None]]) -> None:
        for ticket in tickets:
            give(ticket, problem=None if self._failure is None else StoreError(str(self._failure)))

    def _append(self, group: _Group) -> None:
        """Append the rows of a group and the link that covers them, in one transaction."""
        of_tables = {table: encoded(table, rows) for table, rows in group.rows.items()}
        link = self._link.next({table: len(rows) for table, rows in group.rows.items()}, of_tables)
        self._insert({**group.rows, database.CHAIN: [link.to_row()]})
        self._link = link
        if self._digest is None:
            return
        for table, of_table in of_tables.items():
            if table != "block":
                self._digest.rows(table, of_table)
        for block in group.blocks:
            self._digest.block(*block)

    def _note(self) -> None:
        """Note the head of the chain in the ledger from time to time; a failure does not end the run."""
        is_recent = self._noted is not None and self._noted.elapsed_s() < LEDGER_EVERY_S
        if not self._is_noted or self._failure is not None or is_recent:
            return
        self._noted = Stopwatch()
        try:
            ledger.note(self.folder.name, self._beginning, self._link)
        except OSError as problem:
            self.ledger_problem = f"the ledger of this computer cannot be written ({problem}); the run goes on"

    def _try(self, action: Callable[[T], object], given: T) -> None:
        """Call the action, unless something has failed before."""
        if self._failure is not None:
            return
        try:
            action(given)
        except Exception as problem:  # noqa: BLE001  after any failure nothing may be acknowledged
            failure = StoreError(
                f"the run store cannot write ({problem}). If the disk of the run directory is full, free "
                "some space; everything up to the last completed step is kept."
            )
            self._fail(failure)

    def _fail(self, failure: StoreError) -> None:
        with self._lock:
            self._failure = failure
        self.on_failure(failure)

    def _follow(self, missing: Path) -> None:
        """Fail because the directory was moved, or part of it removed; `folder` is then the location of the record."""
        lost, found = self.folder, self._place.found()
        if found is not None:
            self.folder = found
            self._fail(StoreError(f"the run directory {lost} was moved to {found} during the run; its record is there"))
            return
        kept = self._rescued(partial(rescue, self._database, lost.name, database.FILE_NAME))
        what = f"the run directory {lost}" if missing == lost else str(missing)
        self._fail(StoreError(f"{what} was removed during the run; {kept}"))

    def _rescue_truncated(self, truncated: Path) -> None:
        """Fail because the database was truncated."""
        kept = self._rescued(partial(rescue_database, self._database, self.folder.name, database.FILE_NAME, self._link))
        self._fail(StoreError(f"{truncated} was truncated during the run; {kept}"))

    def _rescued(self, copy: Callable[[], Path]) -> str:
        """Copy the database, and return in words what could be kept; `folder` is then that of the copy, if any."""
        try:
            self.folder = copy()
        except StoreError as problem:
            return str(problem)
        return f"everything recorded until then is in {self.folder}"

    def _insert(self, rows: Mapping[str, Sequence[Row]]) -> None:
        execute = self._database.cursor().execute
        execute("BEGIN IMMEDIATE")
        try:
            for table, values in rows.items():
                for begin in range(0, len(values), ROWS_AT_ONCE):
                    part = values[begin : begin + ROWS_AT_ONCE]
                    execute(_statement(table, len(part)), list(chain.from_iterable(part)))
            execute("COMMIT")
        except BaseException:
            if self._database.in_transaction:
                execute("ROLLBACK")
            raise

    def _close_database(self) -> None:
        try:
            if self._failure is None:
                database.make_one_file(self._database)
            self._database.close()
            self._place.close()
        except sqlite3.Error as problem:
            self._failure = self._failure or StoreError(f"the run store cannot be closed ({problem})")


class _Group:
    """Data of one transaction: rows as stored, and blocks as digested."""

    def __init__(self) -> None:
        self.rows: Rows = defaultdict(list)
        self.blocks: list[tuple[str, str, int, Content]] = []
        self._since = Stopwatch()

    @property
    def due_in_s(self) -> float:
        """Return the remaining time in s until the group must be written; 0 if it is due."""
        return max(0.0, GROUP_S - self._since.elapsed_s())

    def take(self, rows: Rows) -> None:
        """Add rows; blocks of frames are compressed."""
        for table, given in rows.items():
            self.rows[table] += [self._packed(*row) for row in given] if table == "block" else given

    def _packed(self, number: int, stream: str, step: str, block: FrameBlock) -> Row:
        content = content_of(block)
        self.blocks.append((stream, step, len(block), content))
        data, _, crc = packed(content, len(block))
        return (number, stream, step, len(block), float(block.at_s[0]), float(block.at_s[-1]), crc, data)


@lru_cache
def _statement(table: str, rows: int) -> str:
    columns = database.CHAIN_COLUMNS if table == database.CHAIN else database.TABLES[table]
    row = f"({', '.join('?' * columns)})"
    return f"INSERT INTO {table} VALUES {', '.join([row] * rows)}"  # noqa: S608  the names are those above


def _check_finite(name: str, readings: Sequence[Valid]) -> None:
    """Raise StoreError for NaN and infinity; drivers have already checked their readings."""
    if not all(math.isfinite(value) for _, value, _ in readings):
        raise StoreError(f"{name}: a reading was not a number and is not stored; check the instrument")
