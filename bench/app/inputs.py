"""Input files of a run, as copied into its directory."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping

from bench.app.request import PreparedRun
from bench.errors import InputError
from bench.reduce.stored_run import BENCH_COPY, SEQUENCE_COPY, released_copy
from drivers.can.options import text_of
from drivers.schema.fields import DocumentFile

SCENARIO_COPY = "scenario.yaml"
CALLED = "called"  # folder of the sequences that the sequence of a run calls


def inputs_of(prepared: PreparedRun) -> dict[str, str]:
    """Return the text of each input file, by the name of its copy."""
    copies = {SEQUENCE_COPY: prepared.plan.document.text, BENCH_COPY: prepared.loaded.document.text}
    copies |= {released_copy(place): released.text for place, released in prepared.released.items()}
    if prepared.scenario is not None:
        copies[SCENARIO_COPY] = prepared.scenario.text
    copies |= {f"{CALLED}/{document.path.name}": document.text for document in prepared.plan.document.all_included()}
    for role, entry in prepared.loaded.bench.devices.items():
        copies |= {path.name: text_of(path) for path in entry.files.values()}
        for document in (each for each in vars(entry.options).values() if isinstance(each, DocumentFile)):
            name, text = document.path.name, document.path.read_text("utf-8")
            copies[name if copies.get(name, text) == text else f"{role}_{name}"] = text
    return copies


def digest_of(inputs: Mapping[str, str]) -> str:
    """Return the SHA-256 of input files, given as text by name."""
    return hashlib.sha256(json.dumps(dict(inputs), sort_keys=True, ensure_ascii=False).encode()).hexdigest()


def expect_inputs(prepared: PreparedRun) -> None:
    """Raise InputError if a request names the digest of its input files, and they have another."""
    wanted = prepared.request.inputs
    if wanted and wanted != digest_of(inputs_of(prepared)):
        raise InputError(
            "the sequence, the bench file or a file that they name has changed since this run was submitted; check it, "
            "and submit it again"
        )
