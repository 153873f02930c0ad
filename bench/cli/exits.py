"""Exit codes, the same for every command."""

from __future__ import annotations

PASS = 0
FAIL = 1
INPUT_ERROR = 2
BENCH_ERROR = 3
ABORTED = 4

OF_VERDICT = {"PASS": PASS, "FAIL": FAIL, "ERROR": BENCH_ERROR, "INCOMPLETE": BENCH_ERROR, "ABORTED": ABORTED}
