"""The chain of a run's rows, its seal and the ledger: what is altered is said, and where."""

import asyncio
import json
import os
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from bench.errors import StoreError
from bench.quality import Valid
from bench.reduce.reduced_again import reduced_again
from bench.reduce.stored_run import open_run
from bench.report import write
from bench.report.revision import examined
from bench.report.write import write_report
from bench.store.blocks import content_of, packed
from bench.store.ledger import LEDGER, entries_of
from bench.store.reader import RunReader
from bench.store.runs import summary
from bench.store.user_state import state_folder
from bench.store.verify import examine
from bench.store.writer import RunWriter
from drivers.can.frame_block import FrameBlock
from tests.support.runs import run_short, sealed_anew
from tests.support.unpacked import unpack

FORMATS = Path(__file__).parents[2] / "formats"
COMMITS = 20


@pytest.fixture
def sealed(smoke_run, tmp_path):
    """A copy of a run that came to its end."""
    return Path(shutil.copytree(smoke_run.path, tmp_path / smoke_run.path.name))


@pytest.fixture
def interrupted(tmp_path):
    """What is left of a run of twenty commits whose process was killed."""
    name = tmp_path.name  # of which the ledger has nothing yet
    live, folder = tmp_path / "live" / name, tmp_path / name
    live.mkdir(parents=True)
    manifest = {"state": "running", "run": name, "operator": "A. Technician", "units": [{"place": "a", "uut": "QF-1"}]}
    (live / "manifest.json").write_text(json.dumps(manifest))
    (live / "run.lock").touch()

    async def main():
        writer = RunWriter(live)
        for number in range(COMMITS):
            writer.event("step", str(number), value=number)
            writer.frames("counter", "s", frames(30, number))
            writer.readings("air", "°C", [Valid(float(number), 20.0, 1), Valid(number + 0.5, 20.1, 1)])
            writer.samples("dvm", "s", [Valid(float(number), 1.5, 1)])
            await writer.commit()
        shutil.copytree(live, folder)
        writer.close()

    asyncio.run(main())
    return folder


def frames(count, seed):
    draw = np.random.default_rng(seed)
    return FrameBlock(
        draw.integers(0, 2048, count).astype(np.uint32), np.sort(draw.uniform(0, 10, count)),
        np.full(count, 8, np.uint8), draw.integers(0, 256, (count, 8)).astype(np.uint8),
    )  # fmt: skip


def alter(folder, *statements):
    with closing(sqlite3.connect(folder / "run.db")) as database:
        for statement in statements:
            database.execute(statement)
        database.commit()


def edit(path, **changes):
    path.write_text(json.dumps({**json.loads(path.read_text("utf-8")), **changes}, indent=1), "utf-8")


# What is as it was written


def test_a_run_that_came_to_its_end_is_sealed(sealed):
    record = examined(sealed)
    assert (record.kind, record.damage, record.remarks) == ("sealed", (), ())
    assert record.in_words.startswith(f"sealed, {record.rows} rows, head ")
    with RunReader(sealed) as reader:
        assert record.rows == reader.check_chain().links[-1].total


def test_a_run_that_was_interrupted_is_intact_to_its_last_row_and_not_sealed(interrupted):
    record = examined(interrupted)
    assert (record.kind, record.commits, record.rows, record.damage) == ("unsealed", COMMITS, 1 + 5 * COMMITS, ())
    assert record.in_words == "intact up to row 101 (unsealed)"


def kept(version, folder):
    """A run of an earlier format, as its program left it."""
    unpack(FORMATS / f"{version}.tar.xz", folder)
    return folder / f"run_{version}"


@pytest.mark.parametrize(
    ("version", "state", "kind"),
    [
        ("v1_finished", "completed", "unchained"),
        ("v1_interrupted", "interrupted", "unchained"),
        ("v2_finished", "completed", "sealed"),
        ("v2_interrupted", "interrupted", "unsealed"),
    ],
)
def test_runs_of_earlier_formats_are_read_for_ever(tmp_path, version, state, kind):
    folder = kept(version, tmp_path)
    record = examined(folder)
    assert (summary(folder).state, record.kind, record.damage) == (state, kind, ())
    with open_run(folder) as stored:
        found = reduced_again(stored)
    both = [(change.before.value, change.now.value) for change in found.changes if change.before and change.now]
    moved = [(before, now) for before, now in both if before != pytest.approx(now, rel=1e-9)]
    assert (moved, found.verdict) == ([], {"completed": "PASS", "interrupted": "INCOMPLETE"}[state])
    edit(folder / "manifest.json", digest="sha256:0")
    assert examined(folder).damage


@pytest.mark.parametrize("version", ["v2_finished", "v2_interrupted"])
def test_an_edited_block_of_an_earlier_format_is_found(tmp_path, version):
    folder = kept(version, tmp_path)
    with RunReader(folder) as reader:
        block = next(block for _, _, block in reader.blocks())
    edited = FrameBlock(block.ids, block.at_s, block.dlc, block.data ^ 1)
    data, _, crc = packed(content_of(edited), len(edited))
    with closing(sqlite3.connect(folder / "run.db")) as database, database:
        database.execute("UPDATE block SET data = ?, crc = ? WHERE seq = 1", (data, crc))
    with RunReader(folder) as reader:
        assert np.array_equal(next(block for _, _, block in reader.blocks()).data, edited.data)
    assert any("damaged at commit" in each for each in examined(folder).damage)


def test_a_run_cut_off_while_its_database_was_closed_is_read(sealed, tmp_path):
    """A power cut there leaves a half-written database and beside it the journal that takes it back."""
    cut = tmp_path / "cut" / sealed.name
    with closing(sqlite3.connect(sealed / "run.db", isolation_level=None)) as database:
        database.executescript("PRAGMA cache_size=1; BEGIN; UPDATE reading SET value = value + 1")
        shutil.copytree(sealed, cut)
        database.execute("ROLLBACK")
    assert (cut / "run.db").read_bytes() != (sealed / "run.db").read_bytes()
    assert (examined(cut).kind, examined(cut).damage) == ("sealed", ())


# What is altered


@pytest.mark.parametrize("table", ["journal", "block", "channel", "reading", "sample"])
@pytest.mark.parametrize(
    "change",
    [
        "UPDATE {table} SET {column} = {column} || 'x' WHERE rowid = 1",
        "DELETE FROM {table} WHERE rowid = 1",
        "INSERT INTO {table} SELECT 9999, * FROM (SELECT {rest} FROM {table} LIMIT 1)",
    ],
)
def test_every_row_of_every_table_is_under_the_chain(interrupted, table, change):
    columns = {
        "journal": "at_s, kind, step, data", "block": "stream, step, frames, first_s, last_s, crc, data",
        "channel": "name, unit", "reading": "at_s, channel, value", "sample": "at_s, stream, step, value",
    }  # fmt: skip
    for column in columns[table].split(", ") if change.startswith("UPDATE") else ["*"]:
        copy = Path(shutil.copytree(interrupted, interrupted.with_name(f"copy {column.replace('*', '')}")))
        alter(copy, change.format(table=table, column=column, rest=columns[table]))
        record = examine(copy)
        assert record.damage, column
        assert record.rows == (101 if "INSERT" in change else 0)


def test_damage_is_told_by_its_rows_and_what_is_before_and_after_it_is_not(interrupted):
    alter(interrupted, "UPDATE reading SET value = 99 WHERE seq = 21", "UPDATE journal SET kind = '?' WHERE seq = 12")
    record = examine(interrupted)
    assert record.in_words == "DAMAGED; intact up to row 51 (commit 10)"
    assert record.damage == (
        "damaged at commit 11 to 12: among the rows journal 11 to 12, block 11 to 12, reading 21 to 24, "
        "sample 11 to 12",
    )


def test_rows_cut_off_the_end_with_their_links_are_missed_by_the_ledger(interrupted):
    (first,) = entries_of(interrupted.name)
    assert (first.number, first.rows) == (1, 6)
    cut = ["DELETE FROM chain WHERE number > 0"] + [f"DELETE FROM {table}" for table in ("journal", "block", "sample")]
    alter(interrupted, *cut, "DELETE FROM reading", "DELETE FROM channel")
    (damage,) = examine(interrupted).damage
    assert "rows are missing at the end: the ledger has commit 1 with 6 rows" in damage


def test_commits_in_a_damaged_log_are_missed(interrupted):
    log = interrupted / "run.db-wal"
    data = bytearray(log.read_bytes())
    data[len(data.rstrip(b"\0")) // 2] ^= 1
    log.write_bytes(data)
    record = examine(interrupted)
    assert 0 < record.commits < COMMITS
    assert any("commits cannot be read" in each or "commits in it cannot be read" in each for each in record.damage)


def test_a_chain_that_was_made_anew_is_not_the_one_in_the_ledger(sealed):
    ledger = state_folder() / LEDGER
    kept = ledger.read_bytes()
    alter(sealed, "UPDATE reading SET value = value + 1")
    sealed_anew(sealed)
    assert examined(sealed).damage == ()
    ledger.write_bytes(kept)
    assert any("is not the one in the ledger" in each for each in examined(sealed).damage)


@pytest.mark.parametrize("change", [{"operator": "B"}, {"verdict": "FAIL"}, {"units": [{"place": "a", "uut": "QF-2"}]}])
def test_an_edited_manifest_is_said_and_not_shown(sealed, interrupted, change):
    for folder in (sealed, interrupted):
        edit(folder / "manifest.json", **change)
        assert any("manifest.json" in each for each in examine(folder, thoroughly=False).damage)
    assert (summary(sealed).state, summary(sealed).manifest) == ("damaged", {})
    with pytest.raises(StoreError, match=r"DAMAGED.*--damaged"), open_run(sealed):
        pass


@pytest.mark.parametrize("name", ["seal.json", "results.json", "bench.yaml", "run.db"])
def test_a_file_that_is_missing_is_said(sealed, name):
    (sealed / name).unlink()
    assert any(name in each for each in examined(sealed).damage)


def wrong_types(path):
    edit(path, files=5)


def named_pipe(path):
    path.unlink()
    os.mkfifo(path)


def folder_of_the_name(path):
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize(
    ("change", "name", "reported"),
    [
        (Path.unlink, "run.db", "run.db: there is no such file"),
        (Path.unlink, "manifest.json", "manifest.json: there is no such file"),
        (Path.unlink, "results.json", "results.json: there is no such file"),
        (wrong_types, "seal.json", "seal.json: .files is not an object"),
        (named_pipe, "seal.json", "seal.json: cannot be read (is not a regular file)"),
        (named_pipe, "bench.yaml", "bench.yaml: is not a regular file"),
        (folder_of_the_name, "manifest.json", "manifest.json: is a folder"),
    ],
)
def test_what_is_wrong_with_a_file_is_said_as_it_is(sealed, change, name, reported):
    change(sealed / name)
    message = "\n".join(examined(sealed).damage)
    assert reported in message
    for untrue in ("is missing", "is not the one with which the run started", "did not get as far", "before it began"):
        assert untrue not in message
    assert summary(sealed).state == "damaged"
    with pytest.raises(StoreError, match=name), open_run(sealed):
        pass


def test_a_report_that_was_touched_is_said_and_can_be_written_again(sealed, bench_here):
    (sealed / "report.html").write_text("PASS")
    assert "report.html: has changed since it was written" in examined(sealed).damage[0]
    assert bench_here("report", sealed).returncode == 0
    assert examined(sealed).damage == ()
    revisions = sealed / "report_revisions.json"
    revisions.write_text(revisions.read_text("utf-8").replace("20", "19"))
    assert "report_revisions.json: is damaged" in examined(sealed).damage[0]


class PowerCut(BaseException):
    """Ends everything between two writes."""


@pytest.mark.parametrize("is_first", [True, False])
@pytest.mark.parametrize("after_write", [False, True])
def test_a_report_whose_writing_is_cut_off_is_not_called_altered(sealed, monkeypatch, is_first, after_write):
    """Whether the power fails before the report has taken its place or between that and the note that it has."""
    if is_first:
        (sealed / "report.html").unlink()
        (sealed / "report_revisions.json").unlink()
    really = write.write_atomically

    def cut(path, content):
        if after_write:
            really(path, content)
        raise PowerCut

    monkeypatch.setattr(write, "write_atomically", cut)
    monkeypatch.setattr(write, "FORMS", {"html": lambda _: b"another report"})
    with pytest.raises(PowerCut), open_run(sealed) as run:
        write.write_report(run)
    assert examined(sealed).damage == ()
    monkeypatch.setattr(write, "write_atomically", really)
    with open_run(sealed) as run:
        report = write.write_report(run)
    assert examined(sealed).damage == ()
    report.write_text("PASS")
    assert "has changed since it was written" in examined(sealed).damage[0]


def test_a_report_that_was_being_written_is_held_against_what_it_should_become(sealed, monkeypatch):
    (sealed / "report.html").unlink()
    (sealed / "report_revisions.json").unlink()

    def cut(path, content):
        path.write_bytes(content.replace(b"PASS", b"FAIL"))
        raise PowerCut

    monkeypatch.setattr(write, "write_atomically", cut)
    with pytest.raises(PowerCut), open_run(sealed) as run:
        write.write_report(run)
    assert "report.html: is not in report_revisions.json" in examined(sealed).damage[0]


def test_what_lies_beside_is_remarked(sealed):
    (sealed / "notes.txt").write_text("looked at by A.")
    record = examined(sealed)
    assert (record.damage, record.remarks) == ((), ("not covered by the seal: notes.txt",))


def test_what_lies_beside_an_interrupted_run_is_remarked(interrupted):
    before = examined(interrupted)
    (interrupted / "notes.txt").write_text("looked at by A.")
    record = examined(interrupted)
    assert (record.damage, record.rows) == (before.damage, before.rows) == ((), before.rows)
    assert record.remarks == (*before.remarks, "not covered by the chain: notes.txt")


@pytest.mark.lengthy
def test_damaged_data_are_refused_or_what_is_made_of_them_says_so(sealed, tmp_path, bench_here):
    alter(sealed, "UPDATE reading SET value = 1 WHERE seq = 100")
    for command in (["reduce"], ["report"], ["export", "--out", tmp_path / "out"], ["status"], ["runs", "verify"]):
        done = bench_here(
            *command[:2] if command[0] == "runs" else command[:1],
            sealed,
            *command[1:] if command[0] == "export" else [],
        )
        assert (done.returncode, "DAMAGED" in done.stdout + done.stderr) == (3, True), command
    assert not (tmp_path / "out").exists()
    done = bench_here("report", sealed, "--damaged")
    assert done.stdout.strip().endswith("report.DAMAGED.html")
    page = (sealed / "report.DAMAGED.html").read_text("utf-8")
    assert 'class="verdict ERROR"' in page
    assert "THE RECORD OF THIS RUN IS DAMAGED" in page
    assert "THE RECORD IS DAMAGED" in bench_here("reduce", sealed, "--damaged").stdout
    bench_here("export", sealed, "--damaged", "--out", tmp_path / "out")
    assert "run.db: has changed" in (tmp_path / "out" / "DAMAGED.txt").read_text("utf-8")


@pytest.mark.parametrize(
    "change",
    [
        "UPDATE journal SET kind = 'step_bagins' WHERE kind = 'step_begins'",
        "UPDATE journal SET data = replace(data, '+00:00', '+80:00') WHERE kind = 'run_begins'",
    ],
)
def test_what_is_left_of_a_damaged_record_and_cannot_be_read_is_said_in_words(sealed, change):
    alter(sealed, change)
    for read in (reduced_again, write_report):
        with pytest.raises(StoreError) as refused, open_run(sealed, damaged=True) as stored:
            read(stored)
        assert f"{sealed}: DAMAGED" in str(refused.value)
        assert "What is left of it cannot be read (" in str(refused.value)


def test_a_ledger_that_cannot_be_written_is_a_warning(tmp_path, monkeypatch):
    (tmp_path / "state").write_text("no folder")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    result = run_short(tmp_path / "runs", sequence="smoke")
    assert result.outcome.how == "completed"
    assert any("ledger" in problem for problem in result.problems)
    with RunReader(result.path) as reader:
        assert any("ledger" in event.data["text"] for event in reader.events("warning"))
    record = examined(result.path)
    assert (record.kind, record.damage) == ("sealed", ())
