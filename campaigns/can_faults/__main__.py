"""Faults on the buses of counters: `python -m campaigns.can_faults --cases 10000`."""

from __future__ import annotations

import argparse
import sys

from campaigns.can_faults.campaign import play


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--case", type=int, default=None, help="plays one again")
    options = parser.parse_args()
    tally = play(range(options.cases) if options.case is None else [options.case], options.seed)
    for kind, outcomes in sorted(tally.by_kind.items()):
        print(f"{kind:<16} " + ", ".join(f"{count} {what}" for what, count in sorted(outcomes.items())))
    for sentence in tally.unexpected[:20]:
        print(f"    {sentence}")
    total = ", ".join(f"{count} {what}" for what, count in sorted(tally.outcomes.items()))
    verdict = f"{len(tally.unexpected)} UNEXPECTED" if tally.unexpected else "ok"
    print(f"CAN faults: {tally.cases} acquisitions, {sum(tally.outcomes.values())} axes: {total}; {verdict}")
    return 1 if tally.unexpected else 0


if __name__ == "__main__":
    sys.exit(main())
