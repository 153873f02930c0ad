"""The run store: what is acknowledged is durable, what is damaged is told."""

import asyncio
import fcntl
import json
import os
import signal
import sqlite3
import subprocess
import sys
import textwrap
import tracemalloc
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from bench.errors import InputError, StoreError
from bench.loop import AS_FAST_AS_POSSIBLE, run
from bench.quality import Valid
from bench.store import database
from bench.store import writer as writer_module
from bench.store.reader import RunReader
from bench.store.runs import RunDirectory, find_run, list_runs, summary
from bench.store.writer import RunWriter
from drivers.can.frame_block import FrameBlock

STARTED = datetime(2026, 11, 21, 8, 15, 3, tzinfo=UTC)


def block(frames, seed=1):
    draws = np.random.default_rng(seed)
    return FrameBlock(
        draws.integers(0, 0x7FF, frames).astype(np.uint32),
        np.sort(draws.uniform(0, 1e5, frames)),
        np.full(frames, 8, np.uint8),
        draws.integers(0, 256, (frames, 8)).astype(np.uint8),
    )


def written(folder, *actions):
    """Runs `actions` on a writer in virtual time, commits and closes."""

    async def main():
        writer = RunWriter(folder)
        for action in actions:
            action(writer)
        await writer.commit()
        writer.close()

    run(main(), AS_FAST_AS_POSSIBLE)


def test_what_was_written_is_read_back(tmp_path):
    frames = block(41)
    written(
        tmp_path,
        lambda w: w.event("step_ended", "steps/a", label="tumble", value=1.5),
        lambda w: w.frames("counter", "steps/a", frames),
        lambda w: w.readings("air", "°C", [Valid(1.0, 20.5, 1), Valid(2.0, 20.25, 1)]),
        lambda w: w.samples("dvm", "steps/a", [Valid(1.0, 1.1, 1), Valid(2.0, 1.2, 1)]),
        lambda w: w.samples("dvm", "steps/b", [Valid(3.0, 1.3, 1)]),
    )
    with RunReader(tmp_path) as reader:
        (event,) = reader.events()
        assert (event.kind, event.step, event.data) == ("step_ended", "steps/a", {"label": "tumble", "value": 1.5})
        ((stream, step, back),) = reader.blocks()
        assert (stream, step) == ("counter", "steps/a")
        np.testing.assert_array_equal(back.ids, frames.ids)
        np.testing.assert_allclose(back.at_s, frames.at_s, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(back.dlc, frames.dlc)
        np.testing.assert_array_equal(back.data, frames.data)
        series = reader.series("air")
        assert (series.unit, series.at_s.tolist(), series.values.tolist()) == ("°C", [1.0, 2.0], [20.5, 20.25])
        assert series.between(1.5, 2.0).values.tolist() == [20.25]
        assert reader.series("air", [(1.5, 1.75), (1.6, 2.0)]).values.tolist() == [20.25]
        assert reader.series("air", []).values.tolist() == []
        assert reader.envelope("air", 1).values.tolist() == [20.5, 20.25], "a short one as it is"
        assert len(reader.series("nobody").values) == len(reader.envelope("nobody", 1).values) == 0
        samples = reader.samples_by_step()
        assert {step: read["dvm"].tolist() for step, read in samples.items()} == {
            "steps/a": [[1.0, 1.1], [2.0, 1.2]], "steps/b": [[3.0, 1.3]],
        }  # fmt: skip


def test_a_long_channel_is_read_in_parts(tmp_path, monkeypatch):
    monkeypatch.setattr("bench.store.reader.KEPT_READINGS", 30_000)
    values = np.random.default_rng(5).normal(20, 1, 100_000)
    written(tmp_path, lambda w: w.readings("air", "°C", [Valid(float(at_s), v, 1) for at_s, v in enumerate(values)]))
    with RunReader(tmp_path) as reader:
        tracemalloc.start()
        try:
            found = reader.envelope("air", 10).values
            _, peak_bytes = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
        assert reader.series("air").values.tolist() == values.tolist()
    monkeypatch.setattr("bench.store.reader.KEPT_READINGS", len(values))
    with RunReader(tmp_path) as reader:
        assert len(reader.series("air").values) == len(values), "from now on it is kept"
        assert reader.envelope("air", 10).values.tolist() == found.tolist()
    assert found.tolist() == [extreme for part in values.reshape(10, -1) for extreme in (part.min(), part.max())]
    assert peak_bytes < 30_000 * 16 + 500_000 < values.nbytes * 2, "two batches, and what may be kept"


def test_a_run_from_before_there_were_samples_is_read_with_the_same_digest(tmp_path):
    written(tmp_path, lambda w: w.event("run_begins"))
    with RunReader(tmp_path) as reader:
        digest = reader.digest()
    with closing(sqlite3.connect(tmp_path / "run.db")) as connection, connection:
        connection.execute("DROP TABLE sample")
    connection.close()
    with RunReader(tmp_path) as reader:
        assert (reader.samples_by_step(), reader.digest()) == ({}, digest)


def test_the_database_is_in_wal_mode_and_synchronises_every_commit(tmp_path):
    connection = database.create(tmp_path / "run.db")
    assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    assert connection.execute("PRAGMA synchronous").fetchone() == (2,)
    connection.close()


def test_a_disk_that_does_not_take_wal_is_refused():
    with pytest.raises(StoreError, match="does not support what a run store needs"):
        database.create(Path(":memory:"))


def test_a_run_is_digested_while_it_is_written_as_when_it_is_read(tmp_path):
    async def main() -> str:
        writer = RunWriter(tmp_path)
        for number in range(3):
            writer.event("step_ended", "steps/ä", value=number)
            writer.frames("counter", "s", block(50, number))
            writer.readings("air", "°C", [Valid(np.float64(number), 20, 1), Valid(number + 0.1, np.float64(20.1), 1)])
            writer.samples("dvm", "s", [Valid(np.float64(number), np.float64(1.1), 1), Valid(number, 2, 1)])
            await writer.commit()
        writer.close()
        return writer.digest()

    digest = run(main(), AS_FAST_AS_POSSIBLE)
    with RunReader(tmp_path) as reader:
        assert reader.digest() == digest


def test_equal_runs_have_equal_digests_and_different_ones_do_not(tmp_path):
    digests = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        (tmp_path / name).mkdir()
        frames = block(50, seed)
        written(
            tmp_path / name,
            lambda w: w.event("run_begins"),
            lambda w, frames=frames: w.frames("counter", "s", frames),
            lambda w: w.readings("air", "°C", [Valid(1.0, 20.0, 1)]),
        )
        with RunReader(tmp_path / name) as reader:
            digests.append(reader.digest())
    assert digests[0] == digests[1] != digests[2]


@pytest.mark.parametrize("table", ["journal", "block", "channel", "reading", "sample"])
def test_the_digest_sees_a_change_in_every_table(tmp_path, table):
    written(
        tmp_path,
        lambda w: w.event("a", value=1),
        lambda w: w.frames("counter", "s", block(5)),
        lambda w: w.readings("air", "°C", [Valid(1.0, 20.0, 1)]),
        lambda w: w.samples("dvm", "s", [Valid(1.0, 1.1, 1)]),
    )
    with RunReader(tmp_path) as reader:
        before = reader.digest()
    change = {
        "journal": """UPDATE journal SET data = '{"value": 2}'""",
        "block": "UPDATE block SET step = 't'",
        "channel": "UPDATE channel SET name = 'water'",
        "reading": "UPDATE reading SET value = 20.1",
        "sample": "UPDATE sample SET value = 1.2",
    }
    with closing(sqlite3.connect(tmp_path / "run.db")) as connection, connection:
        connection.execute(change[table])
    connection.close()
    with RunReader(tmp_path) as reader:
        assert reader.digest() != before


def test_a_commit_returns_only_when_another_process_can_read_what_was_given(tmp_path):
    async def main():
        writer = RunWriter(tmp_path)
        writer.event("before")
        await writer.commit()
        with closing(sqlite3.connect(tmp_path / "run.db")) as other, other:
            seen = other.execute("SELECT kind FROM journal").fetchall()
        other.close()
        writer.close()
        return seen

    assert run(main(), AS_FAST_AS_POSSIBLE) == [("before",)]


def test_a_run_ends_well_while_somebody_has_its_database_open(tmp_path):
    """A page or a database browser that is left open all night has a connection, and reads nothing at that moment."""

    async def main():
        writer = RunWriter(tmp_path)
        writer.event("run_begins")
        await writer.commit()
        with closing(sqlite3.connect(tmp_path / "run.db")) as other:
            assert other.execute("SELECT COUNT(*) FROM journal").fetchone() == (1,)
            writer.event("run_ended")
            await writer.commit()
            writer.close()
            sealed = (tmp_path / "run.db").read_bytes()
            assert other.execute("SELECT COUNT(*) FROM journal").fetchone() == (2,)
        return sealed

    sealed = run(main(), AS_FAST_AS_POSSIBLE)
    with RunReader(tmp_path) as reader:
        assert [event.kind for event in reader.events()] == ["run_begins", "run_ended"]
    assert (tmp_path / "run.db").read_bytes() == sealed, "what is sealed does not change when the last reader leaves"


def test_nothing_is_written_after_a_failure_and_everybody_hears_of_it(tmp_path, monkeypatch):
    async def main():
        writer = RunWriter(tmp_path)
        writer.event("kept")
        await writer.commit()
        monkeypatch.setattr(
            writer_module, "packed", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device"))
        )
        writer.frames("counter", "s", block(3))
        with pytest.raises(StoreError, match="No space left on device"):
            await writer.commit()
        with pytest.raises(StoreError, match="No space left"):
            writer.event("too late")
        with pytest.raises(StoreError, match="If the disk of the run directory is full, free some space"):
            writer.close()

    run(main(), AS_FAST_AS_POSSIBLE)
    with RunReader(tmp_path) as reader:
        assert [event.kind for event in reader.events()] == ["kept"]


WRITER = """
    import asyncio, sys
    from pathlib import Path
    import numpy as np
    from bench.store.writer import RunWriter
    from drivers.can.frame_block import FrameBlock

    def block(number):
        return FrameBlock(np.array([number], np.uint32), np.array([float(number)]), np.array([8], np.uint8),
                          np.full((1, 8), number % 256, np.uint8))

    async def main():
        writer = RunWriter(Path(sys.argv[1]))
        for number in range(1, 100_000):
            writer.event("step", str(number))
            writer.frames("counter", str(number), block(number))
            await writer.commit()
            print(number, flush=True)

    asyncio.run(main())
"""


@pytest.mark.lengthy
def test_kill_9_loses_nothing_that_was_acknowledged(tmp_path):
    """The writer says each number when its commit has returned; it is killed at many different moments."""
    script = tmp_path / "writer.py"
    script.write_text(textwrap.dedent(WRITER))
    for round_number in range(12):
        folder = tmp_path / str(round_number)
        folder.mkdir()
        process = subprocess.Popen(
            [sys.executable, script, folder], stdout=subprocess.PIPE, text=True,
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])},
        )  # fmt: skip
        assert process.stdout is not None
        acknowledged = 0
        for line in process.stdout:
            acknowledged = int(line)
            if acknowledged >= 5 + 13 * round_number:
                process.send_signal(signal.SIGKILL)
                break
        acknowledged = max([acknowledged, *(int(line) for line in process.stdout.read().split())])
        process.wait()
        process.stdout.close()
        with RunReader(folder) as reader:
            kept = [int(event.step) for event in reader.events()]
            blocks = [int(step) for _, step, _ in reader.blocks()]
        assert kept[:acknowledged] == list(range(1, acknowledged + 1))
        assert blocks == kept


FILE_LIMIT = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))"
MADE = "writer = RunWriter(Path(sys.argv[1]))"


def written_with(tmp_path, *lines):
    """What the writer prints, with these lines in place of that which makes it, and at last its failure."""
    script = tmp_path / "writer.py"
    script.write_text(
        textwrap.dedent(WRITER.replace(MADE, "\n        ".join(lines))).replace(
            "asyncio.run(main())",
            textwrap.dedent("""
        from bench.errors import StoreError
        try:
            asyncio.run(main())
        except StoreError as problem:
            print("FAILED", problem, flush=True)
    """),
        )
    )
    done = subprocess.run(
        [sys.executable, script, tmp_path], capture_output=True, text=True, check=False, timeout=50,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])},
    )  # fmt: skip
    assert done.stdout, done.stderr
    return done.stdout.splitlines()


def test_a_full_disk_ends_the_run_store_and_keeps_what_was_committed(tmp_path):
    lines = written_with(tmp_path, MADE, FILE_LIMIT)
    assert lines[-1].startswith("FAILED the run store cannot write")
    acknowledged = int(lines[-2])
    with RunReader(tmp_path) as reader:
        assert [int(event.step) for event in reader.events()][:acknowledged] == list(range(1, acknowledged + 1))


def test_a_run_does_not_begin_on_a_disk_without_space_for_its_log(tmp_path):
    lines = written_with(tmp_path, FILE_LIMIT, MADE)
    assert lines == [f"FAILED {tmp_path / 'run.db'}: cannot be created ([Errno 27] File too large)"]


def test_run_directories_are_named_by_time_sequence_and_unit_and_never_shared(tmp_path):
    first = RunDirectory.create(tmp_path, STARTED, "tumble_static", "QF-0001")
    second = RunDirectory.create(tmp_path, STARTED, "tumble_static", "QF-0001")
    odd = RunDirectory.create(tmp_path, STARTED, "../etc", "a b/\x1b[31m<x>")
    assert first.path.name == "20261121T081503Z_tumble-static_QF-0001"
    assert second.path.name == "20261121T081503Z_tumble-static_QF-0001_2"
    assert odd.path.name == "20261121T081503Z_etc_a-b-31m-x"
    assert odd.path.parent == tmp_path
    for directory in (first, second, odd):
        directory.release()


def test_a_run_whose_process_died_is_interrupted_and_one_that_lives_is_running(tmp_path):
    directory = RunDirectory.create(tmp_path, STARTED, "s", "u")
    directory.write_json("manifest.json", {"state": "running"})
    assert summary(directory.path).state == "running"
    directory.release()
    assert summary(directory.path).state == "interrupted"
    (directory.path / "manifest.json").write_text('{"state": "comple')
    assert summary(directory.path).state == "damaged"


def test_a_run_is_running_for_others_also_where_its_lock_file_is_removed(tmp_path):
    directory = RunDirectory.create(tmp_path, STARTED, "s", "u")
    directory.write_json("manifest.json", {"state": "running"})
    (directory.path / "run.lock").unlink()
    assert summary(directory.path).state == "running"
    with pytest.raises(InputError, match="this run is under way in another process"):
        RunDirectory.reopen(directory.path)
    directory.release()
    assert summary(directory.path).state == "interrupted"
    RunDirectory.reopen(directory.path).release()


def test_who_only_looks_at_a_run_makes_it_running_for_nobody(tmp_path):
    directory = RunDirectory.create(tmp_path, STARTED, "s", "u")
    directory.write_json("manifest.json", {"state": "running"})
    directory.release()
    locks = [os.open(path, os.O_RDONLY) for path in (directory.path, directory.path / "run.lock")]
    for lock in locks:
        fcntl.flock(lock, fcntl.LOCK_SH)
    assert summary(directory.path).state == "interrupted"
    for lock in locks:
        os.close(lock)


def test_runs_are_found_by_path_id_beginning_and_last(tmp_path):
    made = []
    for minute in (1, 2, 3):
        directory = RunDirectory.create(tmp_path, STARTED.replace(minute=minute), "s", "u")
        directory.write_json("manifest.json", {"state": "completed"})
        directory.release()
        made.append(directory.path)
    (tmp_path / "not a run").mkdir()
    assert [run.path for run in list_runs(tmp_path)] == made
    assert find_run("last", tmp_path) == made[-1]
    assert find_run(str(made[0]), tmp_path) == made[0]
    assert find_run("20261121T0802", tmp_path) == made[1]
    with pytest.raises(InputError, match="is ambiguous"):
        find_run("2026", tmp_path)
    with pytest.raises(InputError, match="there is no run 'x'"):
        find_run("x", tmp_path)
    with pytest.raises(InputError, match="there is no run yet"):
        find_run("last", tmp_path / "empty")


def test_json_never_holds_nan(tmp_path):
    directory = RunDirectory.create(tmp_path, STARTED, "s", "u")
    with pytest.raises(ValueError, match="not JSON compliant"):
        directory.write_json("results.json", {"value": float("nan")})
    directory.write_json("results.json", {"unit": "µg", "value": 1.5})
    assert json.loads((directory.path / "results.json").read_text("utf-8")) == {"unit": "µg", "value": 1.5}
    directory.release()


def test_reading_what_is_not_there_or_of_another_format_is_told(tmp_path):
    with pytest.raises(StoreError, match="there is no such file"):
        RunReader(tmp_path)
    with closing(sqlite3.connect(tmp_path / "run.db")) as connection, connection:
        connection.execute("PRAGMA user_version=99")
    connection.close()
    with pytest.raises(StoreError, match="has format 99, this program reads formats 1 to 3"):
        RunReader(tmp_path)
    (tmp_path / "run.db").write_bytes(b"this is no database at all" * 100)
    with pytest.raises(StoreError, match="cannot be read"):
        RunReader(tmp_path)


def test_a_database_that_is_refused_is_not_left_open(tmp_path):
    bad = tmp_path / "run.db"
    bad.write_bytes(b"this is no database at all" * 100)
    for refuse in (database.create, database.open_to_read):
        with pytest.raises(StoreError) as reported:
            refuse(bad)
        assert reported.tb is not None  # whoever keeps the error keeps its frames, and with them what is open in them
        assert bad not in [link.readlink() for link in Path("/proc/self/fd").iterdir() if link.is_symlink()]


def test_a_writer_works_in_an_ordinary_loop_too(tmp_path):
    async def main():
        writer = RunWriter(tmp_path)
        writer.event("once")
        await writer.commit()
        writer.close()
        writer.close()

    asyncio.run(main())
    with RunReader(tmp_path) as reader:
        assert [event.kind for event in reader.events("once")] == ["once"]
