"""What is said of a record: sealed, intact up to a row, damaged; and of its seal and the ledger."""

from __future__ import annotations

import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from bench.store import database
from bench.store.chain import CHAIN, ChainCheck, check_rows
from bench.store.seal import SEAL
from bench.store.user_state import state_folder
from bench.store.verify import Record, examine


@pytest.mark.parametrize(
    ("record", "told"),
    [
        (Record(Path(), "sealed", 3, 40, "0123456789abcdef01"), "sealed, 40 rows, head 0123456789abcdef"),
        (Record(Path(), "unsealed", 3, 40), "intact up to row 40 (unsealed)"),
        (Record(Path(), "running", 3, 40), "intact up to row 40 (under way)"),
        (Record(Path(), "unchained"), "unsealed, no chain (written by an earlier version); its manifest agrees"),
        (Record(Path(), "unreadable", damage=("x",)), "DAMAGED"),
        (Record(Path(), "sealed", 3, 40, damage=("x",)), "DAMAGED; intact up to row 40 (commit 3)"),
    ],
)
def test_a_record_is_told_in_a_line(record, told):
    assert record.in_words == told


def test_a_sealed_run_is_sealed(smoke_copy):
    record = examine(smoke_copy)
    seal = json.loads((smoke_copy / SEAL).read_text("utf-8"))
    assert record == Record(smoke_copy, "sealed", seal["commits"], seal["rows"], seal["head"])


def test_a_seal_that_cannot_be_read_is_damage_of_a_sealed_run(smoke_copy):
    (smoke_copy / SEAL).write_text("{", "utf-8")
    record = examine(smoke_copy)
    assert record.kind == "sealed"
    assert record.rows > 0
    assert any(each.startswith(f"{smoke_copy / SEAL}: cannot be read (") for each in record.damage)
    assert f"{smoke_copy / SEAL}: is not the one in the ledger" in record.damage


def test_a_seal_that_is_gone_is_known_from_the_ledger(smoke_copy):
    (smoke_copy / SEAL).unlink()
    record = examine(smoke_copy)
    assert record.kind == "unsealed"
    assert record.damage == (
        f"{smoke_copy / SEAL}: the ledger has a seal of this run, but there is no readable seal here",
        f"{smoke_copy / SEAL}: there is no such file",
    )


@pytest.mark.parametrize("key", ["commits", "rows", "head"])
def test_a_seal_of_another_chain_is_told(smoke_copy, key):
    seal = json.loads((smoke_copy / SEAL).read_text("utf-8"))
    other = seal | {key: "0" * 64 if key == "head" else seal[key] + 1}
    (smoke_copy / SEAL).write_text(json.dumps(other), "utf-8")
    told = f"the chain does not end as the seal says, at commit {other['commits']}, row {other['rows']}"
    assert told in examine(smoke_copy).damage
    assert told not in examine(smoke_copy, thoroughly=False).damage


def test_a_digest_that_is_another_is_told(smoke_copy):
    seal = json.loads((smoke_copy / SEAL).read_text("utf-8"))
    (smoke_copy / SEAL).write_text(json.dumps(seal | {"digest": "0" * 64}), "utf-8")
    assert "the data have changed since they were sealed" in examine(smoke_copy).damage


def test_a_run_of_another_computer_has_no_entry_in_the_ledger(smoke_copy, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    assert examine(smoke_copy).remarks == ("the ledger of this computer has no entry for this run",)
    (tmp_path / "state" / "inertial-test-bench" / "ledger.jsonl").mkdir()
    (remark,) = examine(smoke_copy).remarks
    assert remark.startswith("the ledger of this computer cannot be read (")


def test_a_run_of_the_same_name_with_another_beginning_is_told(smoke_copy, tmp_path, monkeypatch):
    shutil.copytree(state_folder(), tmp_path / "state" / "inertial-test-bench")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    path = tmp_path / "state" / "inertial-test-bench" / "ledger.jsonl"
    lines = [json.loads(line) for line in path.read_text("utf-8").splitlines()]
    path.write_text("".join(json.dumps(line | {"beginning": "00", "seal": ""}) + "\n" for line in lines), "utf-8")
    assert "the ledger has a run of this name that began with another manifest" in examine(smoke_copy).damage


def test_a_chain_that_is_not_there_cannot_be_read(smoke_copy):
    with closing(sqlite3.connect(smoke_copy / database.FILE_NAME)) as opened:
        opened.execute(f"DROP TABLE {CHAIN}")
        told = "the chain cannot be read (no such table: chain)"
        assert check_rows(opened) == ChainCheck((), None, (told,))
        opened.commit()
    assert told in examine(smoke_copy).damage
