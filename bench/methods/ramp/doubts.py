"""Doubts about a case of method M4b: implausible data of a chamber or accelerometer (equations 1.10)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from bench.methods.ramp.reduction.legs import Leg
from bench.metrology import plausibility
from bench.metrology.least_squares import Array
from bench.metrology.plausibility import Doubt

WAYS = {"up": "falls", "down": "rises"}  # direction of a leg that contradicts its name
NAMED = 5  # legs named in a message


def ramp(legs: Sequence[Leg], temperature_c: Array, output_g: Array, slope_g_per_c: float | None) -> Iterator[Doubt]:
    """Doubts about a case of M4 dynamic."""
    yield from plausibility.kelvin("T_C", temperature_c)
    rest_g = plausibility.beyond(output_g, plausibility.LARGEST_REST_G)
    if rest_g is not None:
        span_c = np.ptp(temperature_c[np.isfinite(temperature_c)])
        exchanged = "; are T_C and U_V exchanged?" if span_c < 2 else "; see the units of U_V and of K1_V_per_g"
        yield Doubt("implausible_scale", f"U_V over K1_V_per_g goes to {rest_g:.4g} g at rest{exchanged}")
    elif slope_g_per_c is not None and abs(slope_g_per_c) > plausibility.LARGEST_SLOPE_G_PER_C:
        yield Doubt(
            "implausible_scale", f"the slope is {slope_g_per_c * 1e6:.4g} µg/°C: see the units of U_V and of K1_V_per_g"
        )
    frozen = [f"{leg.name} of cycle {leg.cycle}" for leg in legs if len(leg.time_s) > 2 and not np.ptp(leg.output_g)]
    if frozen:
        yield Doubt("implausible_output", f"U_V does not change on the leg {', '.join(frozen[:NAMED])}: it is frozen")
    still = [f"{leg.name} of cycle {leg.cycle}" for leg in legs if plausibility.stands_still(leg.temperature_c)]
    if still:
        yield Doubt("implausible_temperature", f"T_C stands still on the leg {', '.join(still[:NAMED])}: it is frozen")
    for leg in legs:
        yield from list(plausibility.ramp(leg.time_s, leg.temperature_c))[:1]
    against = [leg for leg in legs if leg.against]
    if against:
        ways = ", ".join(f"{leg.name} of cycle {leg.cycle} {WAYS[leg.name]}" for leg in against)
        yield Doubt("legs_exchanged", f"leg: {ways}, and is left out; are up and down exchanged?")
