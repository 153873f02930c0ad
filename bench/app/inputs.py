"""Input files of a run, as copied into its directory."""

from __future__ import annotations

from bench.app.request import PreparedRun
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
