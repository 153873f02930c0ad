"""Faults on the lines to simulated instruments: `python -m campaigns.line_faults --trials 20000`."""

from __future__ import annotations

import argparse
import sys
from collections import Counter, defaultdict

from campaigns.line_faults.campaign import Tally, play
from campaigns.line_faults.cases import CASES, Link
from campaigns.line_faults.gain import UNPROTECTED, believed, one_take
from campaigns.line_faults.orders import ORDERS, play_orders

MEANING = {
    Link.CHECKSUM: "links with a checksum of their own",
    Link.NOTHING: "serial lines without, what enters a result being asked twice",
    Link.TCP: "TCP, faults that come before or behind its checksum",
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=1000, help="readings over all dialects together")
    parser.add_argument(
        "--orders", type=int, default=0, help="orders over all dialects together; a tenth of the readings"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="dialects whose name contains this")
    options = parser.parse_args()
    cases = [name for name in CASES if options.only in name]
    ordered = [name for name in ORDERS if options.only in name]
    sums: dict[Link, Counter[str]] = defaultdict(Counter)
    bad = 0
    for name in cases:
        tally = play(name, CASES[name], -(-options.trials // len(cases)), options.seed)
        sums[CASES[name].link].update(tally.outcomes)
        bad += show(name, tally)
    for name in ordered:
        trials = -(-(options.orders or options.trials // 10) // len(ordered))
        bad += show(f"orders to {name}", play_orders(name, trials, options.seed))
    for link, outcomes in sums.items():
        print(f"{MEANING[link]}: {in_words(outcomes)}")
    if not options.only:
        show_gain(options.trials // 100, options.seed)
    print("line faults: " + (f"{bad} UNEXPECTED" if bad else "ok"))
    return 1 if bad else 0


def show(name: str, tally: Tally) -> int:
    """Print what became of the faults on one dialect; how many sentences should not be there."""
    longest = f"; longest reading {tally.longest_s:.2f} s" if tally.longest_s else ""
    print(f"{name:<36} {in_words(tally.outcomes)}{longest}")
    for sentence in tally.unexpected[:5]:
        print(f"    {sentence}")
    return len(tally.unexpected)


def show_gain(trials: int, seed: int) -> None:
    """Print how many turned bits are believed on serial lines without checksum, by one take and by two."""
    twice, _ = believed(trials, seed)
    with one_take():
        once, _ = believed(trials, seed)
    whole = trials * len(UNPROTECTED)
    print(
        f"{whole} turned bits on serial lines without a checksum: {1000 * once / whole:.1f} ‰ would be believed by one "
        f"take, {1000 * twice / whole:.1f} ‰ are by two"
    )


def in_words(outcomes: Counter[str]) -> str:
    """Each outcome, with how many of a thousand it is."""
    whole = sum(outcomes.values())
    found = ", ".join(f"{count} {what} ({1000 * count / whole:.1f} ‰)" for what, count in sorted(outcomes.items()))
    return f"{whole} faults: {found}"


if __name__ == "__main__":
    sys.exit(main())
