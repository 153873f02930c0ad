"""The trials of the suite with more draws: `python -m campaigns.truth.monte_carlo --draws 1500`.

The scatter of results over their uncertainties is then known to 2 parts in a hundred, and in the suite to 5.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable

from tests.support.monte_carlo import WITHIN, Rows, ratio
from tests.truth.monte_carlo import (
    test_monte_carlo_channel,
    test_monte_carlo_ladder,
    test_monte_carlo_range,
    test_monte_carlo_repeatability,
    test_monte_carlo_response,
    test_monte_carlo_start_up,
)

TRIALS: dict[str, Callable[[int], Rows]] = {
    "range of a gyro": test_monte_carlo_range.gyros,
    "range of an accelerometer": test_monte_carlo_range.centrifuges,
    "response of a gyro": test_monte_carlo_response.gyros,
    "response of an accelerometer": test_monte_carlo_response.accelerometers,
    "thresholds": lambda count: test_monte_carlo_ladder.errors_of(test_monte_carlo_ladder.ladders(1e-6, count)),
    "repeatability": test_monte_carlo_repeatability.trials,
    "start-up": test_monte_carlo_start_up.trials,
    "channel": test_monte_carlo_channel.trials,
}


def main() -> int:
    """Print scatter over uncertainty for every quantity; 1 where one is not within 10 %."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=1500)
    parser.add_argument("--only", choices=TRIALS, action="append")
    options = parser.parse_args()
    problems = []
    for name in options.only or TRIALS:
        print(f"\n{name}, {options.draws} draws")
        for quantity, rows in TRIALS[name](options.draws).items():
            found = ratio(rows)
            print(f"{quantity:<40} n {len(rows):>6}  scatter/u {found:6.3f}", flush=True)
            problems += [f"{name}: {quantity} {found:.3f}"] if abs(found - 1) > WITHIN else []
    print("\n" + ("\n".join(problems) or "truth: ok"))
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
