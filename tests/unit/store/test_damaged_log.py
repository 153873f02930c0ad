"""The log beside the database of an interrupted run: a power cut is no damage, and damage is no power cut."""

import asyncio
import json
import os
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest

from bench.quality import Valid
from bench.store.verify import examine
from bench.store.wal import UnreadablePart, unreadable_part
from bench.store.writer import RunWriter

FRAME = 24 + 4096
HEADER = 32
COMMITS = 12


@pytest.fixture(params=["of full length", "that ends with its last frame"])
def interrupted(tmp_path, request):
    """Files of a run whose process was killed after twelve commits; the last commit also changes the first page."""
    live, folder = tmp_path / "live" / tmp_path.name, tmp_path / tmp_path.name
    live.mkdir(parents=True)
    (live / "manifest.json").write_text(json.dumps({"state": "running", "run": tmp_path.name, "units": []}))
    (live / "run.lock").touch()

    async def main():
        writer = RunWriter(live)
        draw = np.random.default_rng(1)
        for number in range(COMMITS):
            writer.event("step", str(number), value=number)
            values = draw.normal(20, 1, 50 if number < COMMITS - 1 else 500)
            writer.readings("air", "°C", [Valid(float(number), float(value), 1) for value in values])
            await writer.commit()
        shutil.copytree(live, folder)
        writer.close()

    asyncio.run(main())
    if request.param == "that ends with its last frame":
        altered(folder, cut_unused)
    return folder


def frames_of(data):
    """The frames of a log, by where they begin: those with its salts."""
    begins = range(HEADER, len(data), FRAME)
    return [begin for begin in begins if data[begin + 8 : begin + 16] == data[16:24]]


def end_of(data):
    return frames_of(data)[-1] + FRAME


def cut_unused(data):
    del data[end_of(data) :]


def last_commit(data):
    """The frames of the last commit, by where they begin."""
    begins = frames_of(data)
    ends = [begin for begin in begins if struct.unpack(">I", data[begin + 4 : begin + 8])[0]]
    return [begin for begin in begins if begin > ends[-2]]


def altered(folder, alter):
    log = folder / "run.db-wal"
    data = bytearray(log.read_bytes())
    alter(data)
    log.write_bytes(data)
    return examine(folder)


def test_a_log_that_is_whole_says_nothing(interrupted):
    record = examine(interrupted)
    assert (record.commits, record.damage, record.remarks) == (COMMITS, (), ())


@pytest.mark.parametrize("frame", [0, -1])
@pytest.mark.parametrize("at", [3, 16, 24, 24 + 4095])  # page number, checksum, header of the page, its last cell
def test_a_flipped_bit_in_the_last_commit_is_damage(interrupted, frame, at):
    def flip(data):
        data[last_commit(data)[frame] + at] ^= 4

    record = altered(interrupted, flip)
    assert record.commits == COMMITS - 1
    assert any("its last commit cannot be read: it was written completely" in each for each in record.damage)


@pytest.mark.parametrize("salt", [8, 13])
def test_a_flipped_salt_in_the_middle_is_damage(interrupted, salt):
    def flip(data):
        begins = frames_of(data)
        data[begins[len(begins) // 2] + salt] ^= 1

    record = altered(interrupted, flip)
    assert any("commits cannot be read" in each for each in record.damage)


def blank_last_sector(data):
    end = end_of(data)
    data[end - 512 : end] = bytes(512)


def blank_from_within_a_frame(data):
    begin = last_commit(data)[-1] + 512
    data[begin:] = bytes(len(data) - begin)


def cut_in_a_frame(data):
    del data[last_commit(data)[-1] + 100 :]


def cut_by_a_byte(data):
    del data[end_of(data) - 1 :]


def old_frames_behind(data):
    end = end_of(data)
    data[end - 700] ^= 1
    data[end : end + FRAME] = data[HEADER : HEADER + 8] + b"old salt" + data[HEADER + 16 : HEADER + FRAME]


CUTS = [blank_last_sector, blank_from_within_a_frame, cut_in_a_frame, cut_by_a_byte, old_frames_behind]


@pytest.mark.parametrize("cut", CUTS)
def test_what_a_power_cut_may_have_left_is_a_remark(interrupted, cut):
    record = altered(interrupted, cut)
    assert (record.commits, record.damage) == (COMMITS - 1, ())
    assert any("After a power cut, that commit was never acknowledged" in each for each in record.remarks)


def cut_at_a_frame(data):
    del data[last_commit(data)[-1] :]


def blank_from_a_frame_on(data):
    begin = last_commit(data)[-1]
    data[begin:] = bytes(len(data) - begin)


@pytest.mark.parametrize("cut", [cut_at_a_frame, blank_from_a_frame_on])
def test_frames_without_a_commit_are_what_a_killed_process_leaves(interrupted, cut):
    record = altered(interrupted, cut)
    assert (record.commits, record.damage, record.remarks) == (COMMITS - 1, (), ())


def delete_log(folder):
    (folder / "run.db-wal").unlink()
    (folder / "run.db-shm").unlink(missing_ok=True)


def damage_first_commit(folder):
    altered(folder, lambda data: data.__setitem__(HEADER + 600, data[HEADER + 600] ^ 1))


@pytest.mark.parametrize(
    ("damage", "reported"),
    [
        (delete_log, "there is no log run.db-wal beside it"),
        (damage_first_commit, "run.db-wal: its last 14 commits cannot be read"),
    ],
)
def test_a_database_without_its_log_is_no_unknown_format(interrupted, damage, reported):
    damage(interrupted)
    message = "; ".join(examine(interrupted).damage)
    assert reported in message
    assert "the ledger has commit 1 with" in message
    assert "has format 0" not in message


@pytest.mark.parametrize(("make", "reported"), [(Path.mkdir, "is a folder"), (os.mkfifo, "is not a regular file")])
@pytest.mark.parametrize("name", ["run.db", "run.db-wal", "run.db-shm", "run.db-journal"])
def test_what_is_no_file_in_place_of_one_is_said_and_not_waited_for(interrupted, name, make, reported):
    path = interrupted / name
    path.unlink(missing_ok=True)
    make(path)
    assert f"{path}: {reported}" in examine(interrupted).damage


def test_a_log_with_checksums_of_the_other_order_is_read(tmp_path):
    """SQLite writes them in the order of its machine, and reads both."""
    page, salts = 512, (7, 9)
    words = struct.pack(">6I", 0x377F0683, 3007000, page, 0, *salts)
    total = checksum((0, 0), words)
    data = words + struct.pack(">2I", *total)
    for commit in (1, 2):
        head, content = struct.pack(">2I", 1, commit), bytes(range(256)) * 2
        total = checksum(checksum(total, head), content)
        data += head + struct.pack(">4I", *salts, *total) + content
    log = tmp_path / "log"
    log.write_bytes(data)
    assert unreadable_part(log) is None
    log.write_bytes(data[:-1] + b"\0")
    assert unreadable_part(log) == UnreadablePart(1, damage=True)
    log.write_bytes(data[:8] + b"\0\0\1\0" + data[12:])
    assert unreadable_part(log) == UnreadablePart(-1, damage=True)
    for rest in (data[:31], bytes(32)):
        log.write_bytes(rest)
        assert unreadable_part(log) is None


def checksum(total, data):
    """That of SQLite's log, over big-endian words."""
    first, second = total
    for even, odd in struct.iter_unpack(">2I", data):
        first = (first + even + second) % 2**32
        second = (second + odd + first) % 2**32
    return first, second
