"""The part of a station that publishes approved runs."""

from __future__ import annotations

import asyncio
import json

import pytest

from bench.archive.query import opened
from bench.errors import BenchError
from bench.report.approval import APPROVAL, SCHEMA
from bench.station.archiving import Archiving

pytestmark = pytest.mark.slow
WITHIN_S = 60


def approve(run) -> None:
    content = {
        "schema": SCHEMA, "report": "LAB-2026-00001", "run": run.name, "by": "boris",
        "at": "2026-02-01T10:00:00+00:00", "head": "0" * 64, "calibrations": {}, "laboratory": {}, "fields": {},
    }  # fmt: skip
    (run / APPROVAL).write_text(json.dumps(content))


def look(part: Archiving) -> None:
    async def once() -> None:
        async with asyncio.timeout(WITHIN_S):
            await part.look()

    asyncio.run(once())


@pytest.mark.leaves("threads of the libraries of an archive, which stay for the whole process")
def test_a_run_is_published_when_it_is_approved(smoke_copy, tmp_path) -> None:
    part = Archiving(str(tmp_path / "archive"), smoke_copy.parent)
    look(part)
    assert not (tmp_path / "archive").exists()
    approve(smoke_copy)
    look(part)
    sql = "SELECT run, report FROM runs"
    assert opened(str(tmp_path / "archive")).query(sql).rows == [(smoke_copy.name, "LAB-2026-00001")]


def test_a_push_that_fails_is_the_problem_of_the_part_and_is_tried_again(smoke_copy, tmp_path) -> None:
    approve(smoke_copy)
    (tmp_path / "archive").write_text("a file")
    part = Archiving(str(tmp_path / "archive"), smoke_copy.parent)
    for _ in range(2):
        with pytest.raises(BenchError, match=r"the archive .*/archive: "):
            look(part)
    (tmp_path / "archive").unlink()
    look(part)
    assert (tmp_path / "archive" / "archive.json").exists()
