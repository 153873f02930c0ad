"""Names in a sequence by which the reduction tells its readings apart; `rules.py` holds a sequence against them."""

from __future__ import annotations

CLOCKING, VERIFICATION = "clocking", "verification"  # groups whose readings are not fitted
REVERSE, PASS = (
    "reverse",
    "pass",
)  # loops around a reading: of the pass back, and how often both ends were measured before
