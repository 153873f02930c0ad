"""Tasks of a campaign and their results, as the ledger keeps them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, Self


@dataclass(frozen=True)
class Task:
    """Work that is done anywhere with the same result, by the function `does` ("module:function").

    `arguments` are JSON content and contain every seed. Tasks of one `sort` take about as long as each other.
    """

    key: str
    does: str
    arguments: Mapping[str, Any]
    sort: str = ""

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the key, the function and its arguments."""
        return hashlib.sha256(canonical([self.key, self.does, self.arguments]).encode()).hexdigest()


@dataclass(frozen=True)
class Result:
    """Result of a task: its content, or the problem that prevented it.

    `task` is the digest of the task, `program` that of the program that did it.
    """

    key: str
    task: str
    program: str
    content: Any
    problem: str
    took_s: float
    at: str
    worker: str

    @property
    def is_finished(self) -> bool:
        """True unless there was a problem; then the next campaign does the task again."""
        return not self.problem

    def agrees(self, other: Result) -> bool:
        """True if another result of the same task has the same content."""
        return canonical(self.content) == canonical(other.content)

    def to_line(self) -> str:
        """Line of the ledger."""
        return canonical(vars(self))

    @classmethod
    def of_line(cls, line: str) -> Self | None:
        """Return the result in a line; None for a line that is incomplete or something else."""
        try:
            content = json.loads(line)
            return cls(**content) if isinstance(content["task"], str) else None
        except (ValueError, TypeError, KeyError):
            return None


Known = Callable[[Task], Result | None]
"""Lookup of the result of a task."""


class Campaign(Protocol):
    """A kind of campaign with its options."""

    name: str

    def tasks(self, known: Known) -> Sequence[Task]:
        """Return all tasks that are wanted by what is known; results may make further ones necessary."""

    def lines(self, known: Known, out: Path) -> Iterable[str]:
        """Lines on the results; files for people are written to `out`."""

    def exit_code(self, known: Known) -> int:
        """Exit code by the results, as in `bench.cli.exits`, if all tasks are finished."""


def canonical(content: Any) -> str:
    """JSON text that is equal for equal contents."""
    return json.dumps(content, ensure_ascii=False, sort_keys=True, separators=(",", ":"))
