"""Whole runs on a simulated bench in virtual time, for tests."""

from __future__ import annotations

import json
import shutil
import sqlite3
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from bench.app.execute import RunResult, execute
from bench.app.request import RunRequest, prepare
from bench.errors import StoreError
from bench.runner.quiet import Quiet
from bench.store.chain import NOTHING, Link, beginning
from bench.store.database import CHAIN_COLUMNS, FILE_NAME, TABLES
from bench.store.encoded import encoded
from bench.store.ledger import LEDGER
from bench.store.reader import digest_of
from bench.store.runs import MANIFEST, SEAL, RunDirectory
from bench.store.seal import close_record, file_hash
from bench.store.user_state import state_folder
from bench.store.verify import examine

ROOT = Path(__file__).parents[2]
SHORT = (  # the tumble at three temperatures, as short as its soak allows
    "temperatures=[20 °C, 30 °C, 20 °C]", "warm_up=0 s", "soak=30 min", "gate=10 s", "ramp_rate=3 °C/min",
)  # fmt: skip
LARGE = (  # 10 MB of data
    "temperatures=[20 °C, 30 °C, 40 °C, 30 °C, 20 °C]", "warm_up=0 s", "soak=30 min", "gate=1 h", "ramp_rate=3 °C/min",
)  # fmt: skip


def copy_bench(folder: Path, *edits: tuple[str, str], faults: str = "") -> Path:
    """The demonstration bench in a folder of its own, its text edited; every edit must find its text.

    `faults` is the value of `simulation.faults`, as YAML.
    """
    shutil.copytree(ROOT / "config", folder, dirs_exist_ok=True)
    path = folder / "simulated.yaml"
    text = path.read_text("utf-8")
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new)
    if faults:
        text += f"  faults: {faults}\n"
    path.write_text(text, "utf-8")
    return path


def latest(*settings: str) -> tuple[str, ...]:
    """Settings NAME=VALUE of which a later one replaces an earlier one of the same name."""
    return tuple({setting.partition("=")[0]: setting for setting in settings}.values())


def run_short(folder: Path, *, bench: Path | None = None, sequence: str = "tumble_static", **options: Any) -> RunResult:
    """A short run in `folder`; `options` are those of RunRequest, but a report is written only with no_report=False."""
    options.setdefault("no_report", True)
    options.setdefault("settings", SHORT if sequence == "tumble_static" else ())
    request = RunRequest(sequence, bench=str(bench or ROOT / "config" / "simulated.yaml"), runs=folder, **options)
    return execute(prepare(request), Quiet())


def sealed_anew(folder: Path) -> Path:
    """A run that a test has altered, with chain, seal and ledger as if it had been written so; the folder."""
    if not examine(folder).damage:
        return folder
    (state_folder() / LEDGER).unlink(missing_ok=True)
    with closing(sqlite3.connect(folder / FILE_NAME, isolation_level=None)) as database:
        rows = {}
        for table, columns in TABLES.items():  # what was taken out leaves no gap
            found = database.execute(f"SELECT * FROM {table} ORDER BY 1").fetchall()
            rows[table] = [(number, *row[1:]) for number, row in enumerate(found, start=1)]
            database.execute(f"DELETE FROM {table}")
            database.executemany(f"INSERT INTO {table} VALUES ({', '.join('?' * columns)})", rows[table])
        begun = Link(0, NOTHING, beginning(folder / MANIFEST))
        end = begun.next(
            {table: len(of_table) for table, of_table in rows.items()},
            {table: encoded(table, of_table) for table, of_table in rows.items()},
        )
        database.execute("DELETE FROM chain")
        for link in (begun, end):
            database.execute(f"INSERT INTO chain VALUES ({', '.join('?' * CHAIN_COLUMNS)})", link.to_row())
    (folder / SEAL).unlink(missing_ok=True)
    manifest = json.loads((folder / MANIFEST).read_text("utf-8"))
    if manifest["state"] != "running":
        inputs = (name for name in manifest["hashes"] if (folder / name).exists())
        manifest["hashes"] = {name: file_hash(folder / name) for name in inputs}
        digest = ""
        with suppress(StoreError):  # of data that cannot be read
            digest = digest_of(folder)
        close_record(RunDirectory(folder), manifest, begun.head, end, digest)
    return folder


def read_json(result: RunResult, name: str) -> Any:
    """A JSON file of a run directory."""
    return json.loads((result.path / name).read_text("utf-8"))
