"""Exit codes, the same for every command."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # keeps imports out of `bench --help`
    from bench.app.execute import RunResult

PASS = 0
FAIL = 1
INPUT_ERROR = 2
BENCH_ERROR = 3
ABORTED = 4
NOT_JUDGED = 5
NOT_SAFE = 6
INCOMPLETE = 7

MEANINGS = {
    PASS: "PASS: every value that has a limit is within it",
    FAIL: "FAIL: the unit is outside a limit",
    INPUT_ERROR: "bad input: a file, an option or a name cannot be used, or the preflight is not good; nothing was "
    "energised",
    BENCH_ERROR: "ERROR: the bench, the disk or this program failed, or the report could not be written (a "
    "FAIL keeps exit code 1); the bench is safe",
    ABORTED: "ABORTED: ended by the operator, by another program or by its terminal closing; the bench is safe",
    NOT_JUDGED: "NOT JUDGED: the run completed, and no limit applied",
    NOT_SAFE: "NOT MADE SAFE: at least one device may still be energised or moving, or a chamber did not "
    "arrive at its safe set point; takes precedence over all other codes",
    INCOMPLETE: "INCOMPLETE: a step was skipped, or a result could not be determined",
}
OF_VERDICT = {
    "PASS": PASS,
    "FAIL": FAIL,
    "ERROR": BENCH_ERROR,
    "ABORTED": ABORTED,
    "NOT JUDGED": NOT_JUDGED,
    "INCOMPLETE": INCOMPLETE,
}


def of_run(result: RunResult) -> int:
    """Return the exit code of a run or rehearsal."""
    if result.outcome.unsafe:
        return NOT_SAFE
    if result.results is None or result.outcome.how == "error":
        return BENCH_ERROR
    code = OF_VERDICT[result.results.verdict]
    is_complete = result.report is not None or result.no_report
    return code if is_complete or code in (FAIL, ABORTED) else BENCH_ERROR
