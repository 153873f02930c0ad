"""The bars that results must pass against the truth."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence

from campaigns.truth.campaign import QUANTITIES, Comparison

K0_U_LIMIT_G = 2e-6
K1_U_LIMIT = 2e-6  # of the value
RMS = {"perfect": (0.8, 1.25), "full": (0.7, 1.35)}  # of error/u
FAR = {"perfect": 0.01, "full": 1 / 40}  # of the values may be beyond k = 3, or one
LEAST_HELD = 0.9  # of the intervals of largest values


def by_quantity(comparisons: Iterable[Comparison]) -> dict[str, list[Comparison]]:
    """The comparisons of each quantity."""
    found = defaultdict(list)
    for each in comparisons:
        found[each.quantity].append(each)
    return dict(found)


def beyond(found: Mapping[str, Sequence[Comparison]], kind: str) -> Iterator[str]:
    """Quantities beyond the bounds of a "perfect" or a "full" bench; largest values by their intervals (equations 8.8).

    A largest value is not symmetric about its truth: only that its uncertainty is not too small is asked of it beside.
    """
    low, high = RMS[kind]
    for name, comparisons in found.items():
        rms, largest = rms_of(comparisons), any(math.isfinite(each.interval[1]) for each in comparisons)
        held = sum(each.held for each in comparisons) / len(comparisons)
        if held < LEAST_HELD:
            yield f"{name}: {held:.0%} of {len(comparisons)} intervals hold the truth"
        if not (0.0 if largest else low) <= rms <= high:
            yield f"{name}: rms(error/u) is {rms:.3g} over {len(comparisons)} values"
        far = sum(abs(each.ratio) > 3 for each in comparisons)
        if far > max(1, FAR[kind] * len(comparisons)):
            yield f"{name}: {far} of {len(comparisons)} values are beyond k = 3"


def rms_of(comparisons: Iterable[Comparison]) -> float:
    """Of error over u."""
    return _rms([each.ratio for each in comparisons])


def judge_perfect(comparisons: Sequence[Comparison]) -> list[str]:
    """A perfect bench, every dwell of every run: rms(error/u) 0.8 to 1.25, 99 % within k = 3, small uncertainties."""
    found = []
    for quantity in ("K0", "K1_si", "K2", "misalignment", "K3", "Kip", "asymmetry"):
        if not any(c.quantity == quantity for c in comparisons):
            continue
        ratios = [c.ratio for c in comparisons if c.quantity == quantity]
        rms = _rms(ratios)
        if not 0.8 <= rms <= 1.25:
            found.append(f"{quantity}: rms(error/u) is {rms:.3g} over {len(ratios)} dwells")
        beyond = sum(abs(ratio) > 3 for ratio in ratios)
        if beyond > 0.01 * len(ratios):
            found.append(f"{quantity}: {beyond} of {len(ratios)} dwells are beyond k = 3")
    for c in comparisons:
        if c.quantity == "K0" and c.u > K0_U_LIMIT_G:
            found.append(f"seed {c.seed} dwell {c.dwell}: u(K0) is {c.u * 1e6:.2f} µg")
        if c.quantity == "K1" and c.u > K1_U_LIMIT * abs(c.value):
            found.append(f"seed {c.seed} dwell {c.dwell}: u(K1) is {c.u / c.value * 1e6:.2f} ppm")
    return found


def judge_full(comparisons: Sequence[Comparison]) -> list[str]:
    """A full bench, the first dwell of each run: rms(error/u) 0.7 to 1.35, at most one run in 40 beyond k = 3."""
    found = []
    for quantity in QUANTITIES:
        if not any(c.quantity == quantity for c in comparisons):
            continue
        ratios = [c.ratio for c in comparisons if c.quantity == quantity and c.dwell == 0]
        rms = _rms(ratios)
        if not 0.7 <= rms <= 1.35:
            found.append(f"{quantity}: rms(error/u) is {rms:.3g} over {len(ratios)} runs")
        beyond = sum(abs(ratio) > 3 for ratio in ratios)
        if beyond > max(1, len(ratios) // 40):
            found.append(f"{quantity}: {beyond} of {len(ratios)} runs are beyond k = 3")
    return found


def table(comparisons: Sequence[Comparison]) -> Iterable[str]:
    """A line for each quantity: rms, share within k = 2 and 3, mean u."""
    for quantity in QUANTITIES:
        chosen = [c for c in comparisons if c.quantity == quantity]
        if not chosen:  # its angles do not tell it
            continue
        ratios = [c.ratio for c in chosen]
        within = [sum(abs(ratio) <= k for ratio in ratios) / len(ratios) for k in (2, 3)]
        mean_u = sum(c.u for c in chosen) / len(chosen)
        scale = f"rms(error/u) {_rms(ratios):6.3f}  mean {sum(ratios) / len(ratios):+.3f}"
        yield f"{quantity:<14} n {len(ratios):>4}  {scale}  k=2 {within[0]:.1%}  k=3 {within[1]:.1%}  u {mean_u:.3g}"


def _rms(ratios: Sequence[float]) -> float:
    return math.sqrt(sum(ratio * ratio for ratio in ratios) / len(ratios)) if ratios else math.nan
