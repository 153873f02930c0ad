"""Input files of a run, as copied into its directory."""

from __future__ import annotations

import hashlib
import json
from collections import ChainMap
from collections.abc import Mapping
from types import MappingProxyType

from bench.app.request import PreparedRun
from bench.config.bench import LoadedBench
from bench.config.document import Document
from bench.errors import InputError
from bench.store.runs import BENCH_COPY, SEQUENCE_COPY, released_copy
from drivers.can.options import text_of
from drivers.schema.fields import DocumentFile

SCENARIO_COPY = "scenario.yaml"
CALLED = "called"  # folder of the sequences that the sequence of a run calls


def inputs_of(prepared: PreparedRun) -> dict[str, str]:
    """Return the text of each input file, by the name of its copy."""
    copies = sequence_inputs(prepared.plan.document)
    copies |= {released_copy(place): released.text for place, released in prepared.released.items()}
    if prepared.scenario is not None:
        copies[SCENARIO_COPY] = prepared.scenario.text
    return copies | bench_inputs(prepared.loaded, copies)


def sequence_inputs(document: Document) -> dict[str, str]:
    """Return the text of a sequence and of those that it calls, by the names of their copies."""
    called = {f"{CALLED}/{each.path.name}": each.text for each in document.all_included()}
    return {SEQUENCE_COPY: document.text, **called}


def bench_inputs(loaded: LoadedBench, others: Mapping[str, str] = MappingProxyType({})) -> dict[str, str]:
    """Return the text of a bench file and of the files that it names, by names of copies; `others` have theirs."""
    copies = {BENCH_COPY: loaded.document.text}
    known = ChainMap(copies, dict(others))
    for role, entry in loaded.bench.devices.items():
        copies |= {path.name: text_of(path) for path in entry.files.values()}
        for document in (each for each in vars(entry.options).values() if isinstance(each, DocumentFile)):
            name, text = document.path.name, document.path.read_text("utf-8")
            copies[name if known.get(name, text) == text else f"{role}_{name}"] = text
    for certificate in loaded.bench.certificates:  # under their names there, because a reduction reads them again
        copies |= {name: path.read_bytes().decode() for name, path in certificate.files.items()}
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
