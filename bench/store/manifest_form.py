"""Structure of manifests and seals of this version and earlier ones, so that readers need not check types."""

from __future__ import annotations

from datetime import datetime

from bench.store.kept_json import NUMBER, TEXT, TRUTH, WHOLE, list_of, named, nullable, object_of, one_of, pair

STATES = ("running", "completed", "failed", "error", "aborted")
SHOWN_STATES = (*STATES, "interrupted", "damaged")  # states in a list of runs
VERDICTS = ("PASS", "FAIL", "ERROR", "ABORTED", "INCOMPLETE", "NOT JUDGED")
WHOLE_MANIFEST = (  # fields of every manifest since the first version
    "state", "run", "verdict", "title", "sequence", "bench", "operator", "started", "ended", "wall_s", "bench_s",
    "preset", "parameters", "seed", "simulated", "units", "instruments", "hashes", "software", "host", "problems",
)  # fmt: skip


def instant(value: object) -> str:
    """Validate an instant in ISO 8601 with UTC offset."""
    try:
        if isinstance(value, str) and datetime.fromisoformat(value).tzinfo is not None:
            return ""
    except ValueError:
        pass
    return " is not an instant"


_FORMS = {
    "state": one_of(*STATES),
    "run": TEXT,
    "verdict": nullable(one_of(*VERDICTS)),
    "title": TEXT,
    "sequence": TEXT,
    "bench": TEXT,
    "operator": TEXT,
    "order": nullable(TEXT),
    "procedure": nullable(TEXT),
    "started": instant,
    "ended": nullable(instant),
    "wall_s": nullable(NUMBER),
    "bench_s": nullable(NUMBER),
    "preset": nullable(TEXT),
    "parameters": named(TEXT),
    "seed": WHOLE,
    "simulated": list_of(TEXT),
    "units": list_of(object_of({"place": TEXT, "uut": TEXT}, ("place", "uut"))),
    "instruments": named(
        object_of(
            dict.fromkeys(("maker", "model", "serial", "firmware", "fingerprint"), TEXT) | {"serial_verified": TRUTH}
        )
    ),
    "hashes": named(TEXT),
    "software": named(TEXT),
    "host": object_of(dict.fromkeys(("name", "python", "system"), TEXT), ("name", "python", "system")),
    "problems": list_of(TEXT),
    "unsafe": named(TEXT),
    "not_reached": named(TEXT),
    "ended_by": nullable(TEXT),
    "clock_steps": list_of(object_of(dict.fromkeys(("after_s", "set_by_s", "slept_s"), NUMBER))),
    "digest": TEXT,
    "sealed": TRUTH,
    "released": named(
        object_of(
            {"file": TEXT, "uut": TEXT, "run": nullable(TEXT), "verdict": nullable(TEXT), "valid_c": pair(NUMBER)},
            ("file", "uut", "run", "verdict", "valid_c"),
        )
    ),
}
SEAL_SCHEMA = "itb-seal/1"
SEAL_FORM = object_of(
    {
        "schema": one_of(SEAL_SCHEMA), "commits": WHOLE, "rows": WHOLE, "head": TEXT, "digest": TEXT,
        "files": named(TEXT),
    },
    ("schema", "commits", "rows", "head", "digest", "files"),
)  # fmt: skip
MANIFEST_FORM = object_of(_FORMS, ("state",))
WHOLE_FORM = object_of(_FORMS, WHOLE_MANIFEST)
