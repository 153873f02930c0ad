"""Records under hostile hands: writers that are killed, power that is cut, bytes that are altered, directories lost."""

from __future__ import annotations

import fcntl
import json
import multiprocessing
import os
import select
import shutil
import sqlite3
import struct
import subprocess
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.app.execute import execute
from bench.app.request import RunRequest, prepare
from bench.app.resume import prepare_again, read_interrupted
from bench.errors import BenchError
from bench.loop import REAL_TIME
from bench.reduce.reduced_again import reduced_again
from bench.reduce.stored_run import open_run
from bench.report.revision import examined
from bench.runner.quiet import Quiet
from bench.store.database import TABLES
from bench.store.runs import list_runs
from bench.store.seal import file_hash
from bench.store.verify import Record
from bench.store.writer import RunWriter
from campaigns.trials.rows import Row
from tests.support.runs import run_short

KILLS, CUTS, ALTERATIONS, LOST = 200, 200, 400, 10
HALF_OF_THE_ROWS, MOST_ROWS = 100, 180  # of a smoke test, which has some more
IMAGE_BYTES = 64 * 2**20
SHUTDOWN, NO_LOG_FLUSH = 0x8004587D, struct.pack("I", 2)  # what ext4 has for trying a power cut
HAD_ENDED = "had ended when it was interrupted"
ANSWERS = ("damaged", "intact up to an earlier row", "as written, and it is")
ENDS_WITHIN_S = 2.0
LONG = """\
schema: itb-sequence/1
title: A long wait
needs: {supply: power_supply}
setup:
  - {set: supply, voltage: 15 V, current_limit: 120 mA, output: on}
steps:
  - {wait: 10 min}
teardown:
  - {set: supply, output: off}
"""


def trials(scale: float) -> Iterator[Row]:
    """Each line of the record's promises."""
    with tempfile.TemporaryDirectory(prefix="itb-record-") as folder:
        yield killed(Path(folder), max(2, round(KILLS * scale)))
        yield cut(Path(folder), max(2, round(CUTS * scale)))
        yield altered(Path(folder), max(8, round(ALTERATIONS * scale)))
        yield lost(Path(folder), max(1, round(LOST * scale)))


# Writers that are killed, and power that is cut


def killed(folder: Path, count: int) -> Row:
    """`kill -9` at random moments from the start on."""

    return _writers("kill -9: acknowledged rows and inputs are there", folder, count, killed_once)


def killed_once(runs: Path, moment: Moment) -> list[str]:
    """Problem after a run was killed at a moment of it."""
    with running(runs) as run:
        moment.wait(run)
    return wrong_with(runs, run.acknowledged)


def cut(folder: Path, count: int) -> Row:
    """Power cuts of a real ext4 at random moments from the start on."""
    line = "power cut (ext4): acknowledged rows and inputs are there"
    try:
        image, disk = ext4(folder)
    except (OSError, subprocess.CalledProcessError) as problem:
        return Row(line, 0, f"not tried: it needs root, ext4 and loop devices ({problem})", ok=True)
    return _writers(line, folder, count, lambda _, moment: cut_once(image, disk, moment))


def ext4(folder: Path) -> tuple[Path, Path]:
    """The image of an empty ext4, and where to mount it. Raises OSError or CalledProcessError where there is none."""
    image, disk = folder / "ext4.img", folder / "disk"
    disk.mkdir()
    with image.open("wb") as file:
        file.truncate(IMAGE_BYTES)
    do("mkfs.ext4", "-q", "-F", str(image))
    with mounted(image, disk):
        pass
    return image, disk


def cut_once(image: Path, disk: Path, moment: Moment) -> list[str]:
    """Problem after the power of a disk was cut at a moment of a run on it.

    Rows acknowledged from the cut on do not count: `campaigns.reliability.in_flight` shows that ext4 then answers a
    fdatasync under way as done, and after a real cut nobody hears an answer.
    """
    with mounted(image, disk), running(disk / "runs") as run:
        moment.wait(run)
        acknowledged = run.acknowledged
        cut_off(disk)
    with mounted(image, disk):
        found = wrong_with(disk / "runs", acknowledged)
        if acknowledged and not found:
            found += not_resumable(disk / "runs")
        shutil.rmtree(disk / "runs", ignore_errors=True)
    return found


def not_resumable(runs: Path) -> list[str]:
    """Reason why an interrupted run cannot be resumed; none for a run that had ended."""
    (run,) = list_runs(runs)
    try:
        if run.state == "interrupted":
            prepare_again(read_interrupted(run.path))
    except BenchError as problem:
        return [] if HAD_ENDED in str(problem) else [f"cannot be resumed: {problem}"]
    return []


def cut_off(disk: Path) -> None:
    """An ext4 loses what it has not yet written, and accepts no more."""
    handle = os.open(disk, os.O_RDONLY)
    fcntl.ioctl(handle, SHUTDOWN, NO_LOG_FLUSH)
    os.close(handle)


def _writers(line: str, folder: Path, count: int, trial: Callable[[Path, Moment], list[str]]) -> Row:
    """Trials at moments of all of a run, and some beyond its end."""
    draw, took_s = np.random.default_rng(1), whole_s(folder / "first")
    wrong: list[str] = []
    for number in range(count):
        wrong += trial(folder / f"{line[:5]}{number}", Moment.drawn(draw, number, took_s))
    return Row(line, count, f"{len(wrong)} lost{': ' * bool(wrong)}{'; '.join(wrong[:3])}", ok=not wrong)


def whole_s(runs: Path) -> float:
    """Duration of such a run without a disturbance."""
    with running(runs) as run:
        began = time.monotonic()
        run.process.join()
        return time.monotonic() - began


@dataclass(frozen=True)
class Moment:
    """When a run is disturbed: so long after it has begun, and not before so many rows were acknowledged."""

    after_s: float = 0.0
    rows: int = 0

    @classmethod
    def drawn(cls, draw: np.random.Generator, number: int, took_s: float) -> Moment:
        """By rows if the number is even, by time if it is odd: in most of its time a run does not write."""
        if number % 2:
            return cls(after_s=float(draw.uniform(0, 1.1 * took_s)))
        return cls(rows=int(draw.integers(1, MOST_ROWS)))

    def wait(self, run: Running) -> None:
        """Return when it has come, or the run is over."""
        time.sleep(self.after_s)
        while run.acknowledged < self.rows and run.process.is_alive():
            pass


@dataclass
class Running:
    """A run in a process of its own, which reports the number of acknowledged rows."""

    process: Any
    told: int
    _said: bytes = b""
    _is_over: bool = False

    @property
    def acknowledged(self) -> int:
        """Rows acknowledged to the run as durable until now, or until its end."""
        while not self._is_over and select.select([self.told], [], [], 0)[0]:
            data = os.read(self.told, 65536)
            self._said += data
            self._is_over = not data
        lines = self._said.split(b"\n")[:-1]
        return int(lines[-1]) if lines else 0

    def end(self) -> None:
        """Kill it, and return its output."""
        self.process.kill()
        self.process.join()
        _ = self.acknowledged
        self._is_over = True
        os.close(self.told)


@contextmanager
def running(runs: Path) -> Iterator[Running]:
    """A smoke test in virtual time; it is killed when the block ends."""
    told, tell = os.pipe()
    process = multiprocessing.get_context("fork").Process(target=_acknowledging, args=(runs, tell))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of the threads, none of which it needs
        process.start()
    os.close(tell)
    run = Running(process, told)
    try:
        yield run
    finally:
        run.end()


def _acknowledging(runs: Path, tell: int) -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # a disk that has gone is no news here
    really = RunWriter.commit

    async def commit(self: RunWriter) -> None:
        rows = sum(self._numbers.values())
        await really(self)
        os.write(tell, f"{rows}\n".encode())

    RunWriter.commit = commit  # type: ignore[method-assign]
    execute(prepare(RunRequest("smoke", runs=runs)), Quiet())


def wrong_with(runs: Path, acknowledged: int) -> list[str]:
    """Acknowledged rows that are missing or altered."""
    found = list(list_runs(runs))
    if not found:
        return [f"{acknowledged} rows without a run"] if acknowledged else []
    record = examined(found[0].path)
    if record.kind == "unreadable" or not record.rows:
        return [f"{acknowledged} rows: {record.damage}"] if acknowledged else []
    wrong = [*record.damage]
    if record.rows < acknowledged:
        wrong.append(f"{acknowledged} rows were acknowledged, {record.rows} are there")
    hashes = found[0].manifest.get("hashes", {})
    if len(hashes) < 3:
        wrong.append("the manifest knows no inputs")
    return wrong + [
        f"{name} is not whole" for name, of_file in hashes.items() if file_hash(found[0].path / name) != of_file
    ]


@contextmanager
def mounted(image: Path, folder: Path) -> Iterator[None]:
    do("mount", "-o", "loop", str(image), str(folder))
    try:
        yield
    finally:
        do("umount", str(folder))


def do(*command: str) -> None:
    subprocess.run(command, check=True, capture_output=True)


# What is altered


def altered(folder: Path, count: int) -> Row:
    """Flipped bits, cut files and edits of runs that came to their end and of interrupted ones."""
    wrong: list[str] = []
    said = dict.fromkeys(ANSWERS, 0)
    runs = originals(folder)
    for number in range(count):
        what, answer = altered_once(folder, runs[number % 2], number)
        if answer in said:
            said[answer] += 1
        else:
            wrong.append(f"{number}, {what}: {answer}")
    result = ", ".join(f"{times} {words}" for words, times in said.items())
    line = "flipped, cut, edited: none of it is called as written"
    return Row(line, count, f"{len(wrong)} wrong; {result}{'; ' * bool(wrong)}{'; '.join(wrong[:3])}", ok=not wrong)


def altered_once(folder: Path, original: Path, number: int) -> tuple[str, str]:
    """Alteration of a copy of a run, and one of ANSWERS, or the error in the answer."""
    copy = folder / "altered" / original.name
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(original, copy)
    what = alter(copy, np.random.default_rng([2, number]))
    try:
        answer = judged(original, copy, examined(copy))
        with suppress(BenchError), open_run(copy, damaged=True) as stored:
            reduced_again(stored)
    except Exception as problem:  # noqa: BLE001  whatever comes, it is to be told which alteration it was
        return what, f"{type(problem).__name__}: {problem}"
    return what, answer


def judged(original: Path, copy: Path, record: Record) -> str:
    """Evaluate the answer; AssertionError if it is wrong."""
    if record.damage:
        return "damaged"
    if record.kind == "sealed":
        assert _files(copy) == _files(original), "sealed, but not as it was"
        return "as written, and it is"
    kept, now = _files(original), _files(copy)
    assert all(now[name] == kept[name] for name in kept if not name.startswith("run.db")), "inputs are not as they were"
    before, after = _rows(original), _rows(copy)
    assert sum(map(len, after.values())) == record.rows, "not as many rows as it says"
    assert all(after[table] == before[table][: len(after[table])] for table in TABLES), "rows are not as they were"
    return "as written, and it is" if after == before else "intact up to an earlier row"


def _files(folder: Path) -> dict[str, bytes]:
    names = (path for path in folder.rglob("*") if path.is_file() and path.name not in _NO_CONTENT)
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in names}


def _rows(folder: Path) -> dict[str, list[Any]]:
    with closing(sqlite3.connect(f"{(folder / 'run.db').as_uri()}?mode=ro", uri=True)) as database:
        return {table: database.execute(f"SELECT * FROM {table} ORDER BY 1").fetchall() for table in TABLES}


_NO_CONTENT = ("run.lock", "run.db-shm", "runner.json", "reserve.bin")


def originals(folder: Path) -> tuple[Path, Path]:
    """A run that came to its end, and what is left of one that was killed in its middle."""
    finished = run_short(folder / "finished", sequence="smoke", operator="A. Technician", no_report=False).path
    with running(folder / "interrupted") as run:
        while run.acknowledged < HALF_OF_THE_ROWS:
            pass
    (interrupted,) = (folder / "interrupted").iterdir()
    for original in (finished, interrupted):
        assert not examined(original).damage, original
    for name in _NO_CONTENT[1:]:
        (interrupted / name).unlink(missing_ok=True)
    (folder / "altered").mkdir()
    return finished, interrupted


def alter(copy: Path, draw: np.random.Generator) -> str:
    """Do something to a run; what was done."""
    kind = draw.choice(["bit", "cut", "edit"], p=[0.7, 0.15, 0.15])
    if kind == "edit":
        return str(_EDITS[draw.integers(len(_EDITS))](copy, draw))
    names = sorted(name for name, data in _files(copy).items() if data)
    of_database = [name for name in names if name.startswith("run.db")]
    path = copy / str(draw.choice(of_database if draw.random() < 0.5 else names))
    data = bytearray(path.read_bytes())
    place = int(draw.integers(len(data)))
    if kind == "bit":
        data[place] ^= 1 << int(draw.integers(8))
    else:
        del data[place:]
    path.write_bytes(data)
    return f"{kind} at byte {place} of {path.name}"


def _edit_manifest(copy: Path, draw: np.random.Generator) -> str:
    key, value = (
        ("operator", "B. Technician"), ("verdict", "FAIL"), ("units", [{"place": "a", "uut": "QF-9"}]), ("seed", "7"),
        ("problems", None), ("hashes", []), ("started", 5), ("run", {}),
    )[draw.integers(8)]  # fmt: skip
    return _edited(copy / "manifest.json", key, value)


def _edit_results(copy: Path, draw: np.random.Generator) -> str:
    path = copy / "results.json"
    if not path.exists():
        return _edit_manifest(copy, draw)
    key, value = (("verdict", "FAIL"), ("findings", None), ("findings", [{}]), ("verdict", 3))[draw.integers(4)]
    return _edited(path, key, value)


def _edited(path: Path, key: str, value: object) -> str:
    path.write_text(json.dumps({**json.loads(path.read_text("utf-8")), key: value}), "utf-8")
    return f"{path.name}: {key}"


def _edit_rows(copy: Path, draw: np.random.Generator) -> str:
    table = str(draw.choice(["journal", "reading"]))
    column = {"journal": "kind", "reading": "value"}[table]
    statement = (
        f"UPDATE {table} SET {column} = 7 WHERE rowid = 3", f"DELETE FROM {table} WHERE rowid = 4",
        f"DELETE FROM {table} WHERE rowid > 5",
    )[draw.integers(3)]  # fmt: skip
    with closing(sqlite3.connect(copy / "run.db", isolation_level=None)) as database:
        database.execute(statement)
    return statement


_EDITS = (_edit_manifest, _edit_results, _edit_rows)


# Directories that are lost


def lost(folder: Path, count: int) -> Row:
    """A directory that is moved or removed while a step waits in real time."""
    sequence = folder / "long.yaml"
    sequence.write_text(LONG, "utf-8")
    draw = np.random.default_rng(3)
    wrong, slowest_s = [], 0.0
    for number in range(count):
        runs = folder / f"lost{number}"
        took_s, wrong_here = _lost_after(sequence, runs, float(draw.uniform(0.5, 2.0)), remove=number % 2 == 1)
        slowest_s = max(slowest_s, took_s)
        wrong += wrong_here
    line = f"directory moved or removed: ended and safe within {ENDS_WITHIN_S:g} s, record kept"
    result = f"{len(wrong)} wrong, the slowest {slowest_s:.1f} s{'; ' * bool(wrong)}{'; '.join(wrong[:3])}"
    return Row(line, count, result, ok=not wrong)


def _lost_after(sequence: Path, runs: Path, delay_s: float, *, remove: bool) -> tuple[float, list[str]]:
    times: dict[str, float] = {}

    class Watches(Quiet):
        def step_begins(self, planned: Any, index: int) -> None:
            if planned.phase == "steps":
                timer.start()
            elif planned.phase == "teardown":
                times["teardown"] = time.monotonic()

    def lose() -> None:
        times["lost"] = time.monotonic()
        if remove:
            shutil.rmtree(runs)
        else:
            runs.rename(runs.with_name(f"{runs.name} moved"))

    timer = threading.Timer(delay_s, lose)
    result = execute(prepare(RunRequest(str(sequence), runs=runs, speed=REAL_TIME)), Watches())
    took_s = times["teardown"] - times["lost"]
    record = examined(result.path)
    wrong = [*record.damage, *(f"{device} is not safe" for device in result.outcome.unsafe)]
    if took_s > ENDS_WITHIN_S:
        wrong.append(f"ended after {took_s:.1f} s")
    if record.kind != "sealed" or str(result.path) not in result.problems[0]:
        wrong.append(f"its record is {record.kind}: {result.problems[0]}")
    return took_s, wrong
