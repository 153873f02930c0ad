"""The scorecard: `python -m campaigns.reliability [--minutes 10] [--only S16 …] [--trial S16:123] [--failed]`.

Trials are numbered, and a number always draws the same. Results are appended to build/reliability/results.jsonl, so
that a campaign goes on where it was stopped; --failed tries those again that have failed. Without --minutes the table
is printed as it is. --keep enters them in campaigns/reliability/results.tsv, from which every computer goes on, and
in the table of docs/explanation/reliability.md.
"""

from __future__ import annotations

import argparse
import sys

from campaigns.reliability.campaign import KEPT, Results, carry_on
from campaigns.reliability.kept import write_kept
from campaigns.reliability.scorecard import LINES, Line
from campaigns.reliability.table import PAGE, table, with_counts


def _trial(text: str) -> tuple[Line, int]:
    key, _, number = text.partition(":")
    return LINES[key], int(number)


def main() -> int:
    """Exit status 1 when a trial has failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=0.0, help="how long to go on")
    parser.add_argument("--only", action="append", choices=LINES, metavar="LINE", help="a line; may be repeated")
    parser.add_argument("--trial", type=_trial, metavar="LINE:NUMBER", help="play one trial, here, and keep nothing")
    parser.add_argument("--failed", action="store_true", help="try those again that have failed")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--keep", action="store_true", help="enter the results in the repository and its page")
    options = parser.parse_args()
    if options.trial is not None:
        line, number = options.trial
        wrong = line.trial(number)
        sys.stdout.write(f"{line.key}:{number}: {wrong or 'as it should be'}\n")
        return 1 if wrong else 0
    lines = [LINES[key] for key in options.only or LINES]
    results = Results()
    if options.minutes:
        carry_on(lines, results, options.minutes * 60, options.workers, failed=options.failed)
    if options.keep:
        write_kept(KEPT, results.all())
        PAGE.write_text(with_counts(PAGE.read_text("utf-8"), results), "utf-8")
    sys.stdout.write(table(lines, results))
    return 1 if any(results.failed(line) for line in lines) else 0


if __name__ == "__main__":
    sys.exit(main())
