"""The reader of raw blocks, as it stands in its page."""

import asyncio
import re
import sqlite3
from contextlib import closing

import numpy as np
import pytest

from bench.store.blocks import content_of
from bench.store.reader import RunReader
from bench.store.writer import RunWriter
from drivers.can.frame_block import FrameBlock
from tests.support.frames import counted
from tests.support.how_to import FOLDER

COLUMNS = (("time_s", "at_s"), ("id", "ids"), ("length", "dlc"), ("data", "data"))
PROGRAM = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)


@pytest.fixture(scope="module")
def page():
    (program,) = PROGRAM.findall((FOLDER / "read_raw_data.md").read_text("utf-8"))
    assert program.count("\n") <= 65
    found = {}
    exec(compile(program, "read_raw_data.md", "exec"), found)
    return found


def test_it_reads_what_the_program_reads(smoke_run, page):
    run = smoke_run.path
    with RunReader(run) as reader:
        blocks = [block for stream, _, block in reader.blocks() if stream == "counter"]
        step = next(step for _, step, _ in reader.blocks())
        of_step = reader.frames_of(step)["counter"]
    found = page["read_frames"](run, "counter")
    assert len(found) == sum(map(len, blocks)) > 500
    for column, name in COLUMNS:
        expected = np.concatenate([getattr(block, name) for block in blocks])
        assert np.array_equal(found[column], expected), column
    assert np.array_equal(page["read_frames"](run, "counter", step)["time_s"], of_step.at_s)
    assert len(page["read_frames"](run, "nobody")) == 0


def test_it_reads_blocks_of_both_forms(tmp_path, page):
    """Of which those of a smoke run are short."""
    number = np.arange(1000, dtype=np.uint64)
    blocks = [counted(700), counted(20)]
    for kind in ("<u8", ">u8"):
        data = (number * 257).astype(kind).view(np.uint8).reshape(-1, 8)
        blocks.append(FrameBlock(np.full(1000, 5, np.uint32), number / 100, np.full(1000, 8, np.uint8), data))
    assert [content_of(block).by_message for block in blocks] == [True, False, True, True]

    async def main():
        writer = RunWriter(tmp_path)
        for block in blocks:
            writer.frames("counter", "s", block)
        writer.close()

    asyncio.run(main())
    found, expected = page["read_frames"](tmp_path, "counter"), FrameBlock.joined(blocks)
    for column, name in COLUMNS:
        assert np.array_equal(found[column], getattr(expected, name)), column


def test_it_says_that_a_block_is_damaged(smoke_copy, page):
    with closing(sqlite3.connect(smoke_copy / "run.db")) as database:
        database.execute("UPDATE block SET crc = crc + 1 WHERE seq = 1")
        database.commit()
    with pytest.raises(ValueError, match="block 1 is damaged"):
        page["read_frames"](smoke_copy, "counter")
