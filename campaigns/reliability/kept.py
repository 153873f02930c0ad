"""Results of trials as they are kept in the repository: a row for trials that follow each other and passed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from tests.support.runs import ROOT

HEAD = "line\tfirst\tlast\tday\tcommit\twrong\n"


class Result(NamedTuple):
    """The outcome of a trial; `wrong` is "" where it passed, `took_s` 0 where it is not known any more."""

    line: str
    trial: int
    wrong: str
    took_s: float
    at: str
    commit: str


class _Row(NamedTuple):
    line: str
    first: int
    last: int
    day: str
    commit: str
    wrong: str

    def continued_by(self, other: _Row) -> bool:
        same = (self.line, self.day, self.commit) == (other.line, other.day, other.commit)
        return same and not (self.wrong or other.wrong) and other.first == self.last + 1


def read_kept(path: Path) -> Iterator[Result]:
    """Every trial in a file of kept results."""
    for text in path.read_text("utf-8").splitlines()[1:]:
        line, first, last, day, commit, wrong = text.split("\t")
        for trial in range(int(first), int(last) + 1):
            yield Result(line, trial, wrong, 0.0, day, commit)


def write_kept(path: Path, results: Iterable[Result]) -> None:
    """Write results, which are sorted by line and number; one that failed has a row of its own."""
    rows: list[_Row] = []
    for each in results:
        wrong = " ".join(each.wrong.replace(f"{ROOT}/", "").split())
        row = _Row(each.line, each.trial, each.trial, each.at[:10], each.commit, wrong)
        if rows and rows[-1].continued_by(row):
            rows[-1] = rows[-1]._replace(last=row.last)
        else:
            rows.append(row)
    path.write_text(HEAD + "".join("\t".join(map(str, row)) + "\n" for row in rows), "utf-8")
