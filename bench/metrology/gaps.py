"""Gaps of an acquisition: rows of lost latches or samples, by their first and last numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from bench.metrology.acquisition import Array, Codes, Counts, Integers
from bench.metrology.missed import Gap, Missed
from bench.metrology.pulse_counts import mean_rate
from bench.metrology.sampled_codes import mean_code

EVENT = "gaps"  # of the journal; its data are those of a Missed, with device and channel
MOST_LISTED = 8  # gaps listed per channel and acquisition; all can be recovered from the raw data
NOT_OF_GAPS = frozenset({"dead_band", "stuck_code"})  # other problems of a mean


def missed_in(found: Counts | Codes) -> Missed | None:
    """Lost latches or samples of a channel in an acquisition; None if there are none."""
    if not len(found.gaps):
        return None
    what: Literal["latches", "samples"]
    if isinstance(found, Codes):
        what, came, problems = "samples", len(found.sequence) + found.invalid, mean_code(found).problems
    else:
        what, came, problems = "latches", len(found.sequence), mean_rate(found).problems
    return Missed(
        what=what,
        gaps=len(found.gaps),
        lost=found.lost,
        expected=came + found.lost,
        listed=gaps_of(found, MOST_LISTED),
        unusable=tuple(problem for problem in problems if problem not in NOT_OF_GAPS),
    )


def missed_of(device: str, decoded: Mapping[str, Counts | Codes]) -> dict[tuple[str, str], Missed]:
    """Losses of the channels of a device in an acquisition, by device and channel; only channels with losses."""
    found = {(device, channel): missed_in(each) for channel, each in decoded.items()}
    return {name: missed for name, missed in found.items() if missed is not None}


def gaps_of(found: Counts | Codes, at_most: int | None = None) -> tuple[Gap, ...]:
    """Gaps of a channel in an acquisition, or the first of them."""
    gaps = found.gaps[:at_most]
    after = np.searchsorted(found.sequence, gaps[:, 0]).tolist()
    return tuple(
        Gap(first, last, *_around(found, place)) for (first, last), place in zip(gaps.tolist(), after, strict=True)
    )


def _around(found: Counts | Codes, place: int) -> tuple[float | None, float | None, float | None]:
    """Arrival times of the rows before and at an index, and the time between them by the device's clock."""
    from_s = float(found.host_s[place - 1]) if place else None
    to_s = float(found.host_s[place]) if place < len(found.host_s) else None
    if from_s is None or to_s is None:
        return from_s, to_s, None
    ticks = int(found.tick[place] - found.tick[place - 1]) & ((1 << found.tick_bits) - 1)
    return from_s, to_s, round(ticks * found.tick_period_s, 9)


def gap_columns(found: Counts | Codes) -> Mapping[str, Integers | Array]:
    """All gaps of a channel in an acquisition, by the fields of a Gap, each (G,); not-a-number for missing values."""
    around = [(gap.from_s, gap.to_s, gap.device_s) for gap in gaps_of(found)]
    times = np.array(around, np.float64).reshape(-1, 3)
    return {
        "first": found.gaps[:, 0], "last": found.gaps[:, 1],
        "from_s": times[:, 0], "to_s": times[:, 1], "device_s": times[:, 2],
    }  # fmt: skip
