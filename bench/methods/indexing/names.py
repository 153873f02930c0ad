"""Names in a sequence by which the reduction distinguishes its readings; `rules.py` checks sequences against them."""

from __future__ import annotations

CLOCKING, VERIFICATION = "clocking", "verification"  # groups whose readings are not part of the fit
REVERSE, PASS = (
    "reverse",
    "pass",
)  # loops around a reading: the reverse pass, and the number of preceding measurements of both ends
