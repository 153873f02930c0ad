"""Ledger: chain heads of this user's runs, stored outside the run directories.

Each line of JSON is durable and never rewritten. It reveals accidental changes to a run; the owner of the computer can
change both, so protection against that needs a copy of a head elsewhere.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass

from bench.clock import wall_utc
from bench.files import append_line
from bench.store.chain import Link
from bench.store.kept_json import TEXT, WHOLE, object_of
from bench.store.user_state import state_folder

LEDGER = "ledger.jsonl"


_FORM = object_of({
    "run": TEXT, "beginning": TEXT, "number": WHOLE, "rows": WHOLE, "head": TEXT, "utc": TEXT, "seal": TEXT,
})  # fmt: skip


@dataclass(frozen=True)
class LedgerEntry:
    """Line of the ledger: run, head of link 0, a link, and the SHA-256 of the seal if there is one.

    Heads are hexadecimal.
    """

    run: str
    beginning: str
    number: int
    rows: int
    head: str
    utc: str
    seal: str = ""


def note(run: str, beginning: bytes, link: Link, seal: str = "") -> None:
    """Append a head, durably. Raises OSError."""
    utc = wall_utc().isoformat(timespec="seconds")
    line = LedgerEntry(run, beginning.hex(), link.number, link.total, link.head.hex(), utc, seal)
    text = json.dumps(asdict(line), ensure_ascii=False)
    append_line(state_folder() / LEDGER, text)


def entries_of(run: str) -> Iterator[LedgerEntry]:
    """Yield the entries of a run, oldest first; lines that cannot be read are ignored. Raises OSError."""
    path = state_folder() / LEDGER
    if not path.exists():
        return
    with path.open(encoding="utf-8", errors="replace") as lines:
        for line in lines:
            if run in line and (found := _read(line)) is not None and found.run == run:
                yield found


def _read(line: str) -> LedgerEntry | None:
    try:
        found = LedgerEntry(**json.loads(line))
    except (ValueError, TypeError, RecursionError):
        return None
    return found if _FORM(asdict(found)) == "" else None
