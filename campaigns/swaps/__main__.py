"""Swapped instruments and second masters: `python -m campaigns.swaps --trials 200`."""

from __future__ import annotations

import argparse
import sys

from campaigns.swaps.campaign import second_masters, swaps


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=200, help="of each")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    bad = 0
    for name, play in (("swaps", swaps), ("second masters", second_masters)):
        tally = play(options.trials, options.seed)
        outcomes = ", ".join(f"{count} {what}" for what, count in sorted(tally.outcomes.items()))
        print(f"{name:<15} {tally.trials}: {outcomes}")
        for sentence in tally.unexpected[:10]:
            print(f"    {sentence}")
        bad += len(tally.unexpected)
    print("swaps: " + (f"{bad} UNEXPECTED" if bad else "ok"))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
