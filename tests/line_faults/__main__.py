"""Faults on the lines to simulated instruments: `python -m tests.line_faults --trials 20000`."""

from __future__ import annotations

import argparse
import sys

from tests.line_faults.campaign import play
from tests.line_faults.cases import CASES


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=1000, help="over all dialects together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="dialects whose name contains this")
    options = parser.parse_args()
    cases = {name: case for name, case in CASES.items() if options.only in name}
    bad = 0
    for name, case in cases.items():
        tally = play(name, case, -(-options.trials // len(cases)), options.seed)
        outcomes = ", ".join(f"{count} {what}" for what, count in sorted(tally.outcomes.items()))
        print(f"{name:<20} {tally.trials} faults: {outcomes}; longest reading {tally.longest_s:.2f} s")
        for sentence in tally.unexpected[:5]:
            print(f"    {sentence}")
        bad += len(tally.unexpected)
    print("line faults: " + (f"{bad} UNEXPECTED" if bad else "ok"))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
