"""Which revision of its report a run is at."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from bench.clock import wall_utc
from bench.errors import StoreError
from bench.report.findings import Results
from bench.store.runs import json_text, write_whole

REVISIONS = "report_revisions.json"


@dataclass(frozen=True)
class Revision:
    """The number of a report is that of its run with this revision; `issued` is when it first said what it says."""

    number: int
    issued: datetime


def revision_of(folder: Path, manifest: Mapping[str, Any], results: Results | None, not_evaluated: str) -> Revision:
    """The revision of a report that says this, kept in the run directory with the hashes of those before.

    The same content in another form or language is no new revision; what another version of this program says is one.
    Raises StoreError where the list of revisions cannot be read or written.
    """
    content = {
        "manifest": manifest,
        "results": results.to_json() if results is not None else None,
        "not_evaluated": not_evaluated,
        "program": version("inertial-test-bench"),
    }
    text = json.dumps(content, ensure_ascii=False, sort_keys=True)
    content_hash = "sha256:" + hashlib.sha256(text.encode()).hexdigest()
    known = _known(folder / REVISIONS)
    if not known or known[-1]["content"] != content_hash:
        issued = wall_utc().isoformat(timespec="seconds")
        known.append({"revision": len(known) + 1, "issued": issued, "content": content_hash})
        write_whole(folder / REVISIONS, json_text(known).encode())
    return Revision(len(known), datetime.fromisoformat(known[-1]["issued"]))


def _known(path: Path) -> list[dict[str, Any]]:
    if not path.is_file():
        return []
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        return [
            {
                "revision": int(each["revision"]),
                "issued": datetime.fromisoformat(each["issued"]).isoformat(),
                "content": str(each["content"]),
            }
            for each in found
        ]
    except (OSError, ValueError, TypeError, LookupError) as problem:
        raise StoreError(
            f"{path}: is damaged ({problem}), so the revision of the report is not known; put it back from a copy, or "
            "move it away to begin with revision 1"
        ) from problem
