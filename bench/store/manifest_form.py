"""Structure of manifests and seals of this version and earlier ones, so that readers need not check types."""

from __future__ import annotations

from datetime import datetime

from bench.store.kept_json import NUMBER, TEXT, TRUTH, WHOLE, an_object, every, named, one_of, or_none, pair

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
    "verdict": or_none(one_of(*VERDICTS)),
    "title": TEXT,
    "sequence": TEXT,
    "bench": TEXT,
    "operator": TEXT,
    "order": or_none(TEXT),
    "procedure": or_none(TEXT),
    "started": instant,
    "ended": or_none(instant),
    "wall_s": or_none(NUMBER),
    "bench_s": or_none(NUMBER),
    "preset": or_none(TEXT),
    "parameters": named(TEXT),
    "seed": WHOLE,
    "simulated": every(TEXT),
    "units": every(an_object({"place": TEXT, "uut": TEXT}, ("place", "uut"))),
    "instruments": named(
        an_object(
            dict.fromkeys(("maker", "model", "serial", "firmware", "fingerprint"), TEXT) | {"serial_verified": TRUTH}
        )
    ),
    "hashes": named(TEXT),
    "software": named(TEXT),
    "host": an_object(dict.fromkeys(("name", "python", "system"), TEXT), ("name", "python", "system")),
    "problems": every(TEXT),
    "unsafe": named(TEXT),
    "not_reached": named(TEXT),
    "ended_by": or_none(TEXT),
    "clock_steps": every(an_object(dict.fromkeys(("after_s", "set_by_s", "slept_s"), NUMBER))),
    "digest": TEXT,
    "sealed": TRUTH,
    "released": named(
        an_object(
            {"file": TEXT, "uut": TEXT, "run": or_none(TEXT), "verdict": or_none(TEXT), "valid_c": pair(NUMBER)},
            ("file", "uut", "run", "verdict", "valid_c"),
        )
    ),
}
SEAL_SCHEMA = "itb-seal/1"
SEAL_FORM = an_object(
    {
        "schema": one_of(SEAL_SCHEMA), "commits": WHOLE, "rows": WHOLE, "head": TEXT, "digest": TEXT,
        "files": named(TEXT),
    },
    ("schema", "commits", "rows", "head", "digest", "files"),
)  # fmt: skip
MANIFEST_FORM = an_object(_FORMS, ("state",))
WHOLE_FORM = an_object(_FORMS, WHOLE_MANIFEST)
