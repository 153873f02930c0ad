"""Results of a campaign on the disk: a line for each, durable before the next task is counted as done."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from bench.campaign.tasks import Result, Task
from bench.errors import InUseError, StoreError
from bench.files import append_line, make_folder, sync_folder

RESULTS, DIFFERING = "results.jsonl", "differing.jsonl"


class Ledger:
    """Results of one program in a folder; others in its file are kept and not used.

    A finished result stays. The second one of a task must agree with it; one that does not is kept beside, in
    `differing`.
    """

    def __init__(self, folder: Path, program: str) -> None:
        self.folder, self.program = folder, program
        self._found: dict[str, Result] = {}
        self._differing: list[Result] = []
        self.others = 0  # results of other programs
        for result in _read(folder / RESULTS):
            self._keep(result)
        self._differing = [each for each in _read(folder / DIFFERING) if each.program == program]

    def known(self, task: Task) -> Result | None:
        """Return the result of a task, or None."""
        return self._found.get(task.digest)

    def is_finished(self, task: Task) -> bool:
        """True if a task has a result without a problem."""
        result = self.known(task)
        return result is not None and result.is_finished

    def differing(self, tasks: Iterable[Task]) -> list[Result]:
        """Second results of tasks that do not agree with the first."""
        wanted = {task.digest for task in tasks}
        return [each for each in self._differing if each.task in wanted]

    def add(self, results: Sequence[Result]) -> None:
        """Keep results, on the disk when this returns. Raises StoreError."""
        new = []
        for result in results:
            before = self._found.get(result.task)
            if before is None or not before.is_finished:
                new.append(result)
                self._found[result.task] = result
            elif result.is_finished and not result.agrees(before):
                _append(self.folder / DIFFERING, [result])
                self._differing.append(result)
        if new:
            _append(self.folder / RESULTS, new)

    def _keep(self, result: Result) -> None:
        if result.program != self.program:
            self.others += 1
            return
        before = self._found.get(result.task)
        if before is None or not before.is_finished:
            self._found[result.task] = result


@contextmanager
def opened(folder: Path, program: str) -> Iterator[Ledger]:
    """Open the ledger of a folder, which is created if missing, for this process alone.

    Raises InUseError if another process has it open, and StoreError.
    """
    try:
        make_folder(folder)
        lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError as problem:
        raise StoreError(f"{folder}: cannot be written ({problem})") from None
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InUseError(f"{folder}: another campaign writes there; wait for its end, or give --out DIR") from None
        yield Ledger(folder, program)
    finally:
        os.close(lock)


def _read(path: Path) -> Iterator[Result]:
    """Yield the results in a file; lines that a crash has cut are passed over."""
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            for line in file:
                if (result := Result.of_line(line)) is not None:
                    yield result
    except FileNotFoundError:
        return
    except OSError as problem:
        raise StoreError(f"{path}: cannot be read ({problem})") from None


def _append(path: Path, results: Sequence[Result]) -> None:
    is_new = not path.exists()
    try:
        append_line(path, "\n".join(result.to_line() for result in results), permissions=0o644)
        if is_new:
            sync_folder(path.parent)
    except OSError as problem:
        raise StoreError(f"{path}: cannot be written ({problem}); free space, and repeat the command") from None
