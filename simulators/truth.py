"""What a perfect bench would have found: the channel's true constants, for the file that no reduction reads.

They are defined as the results are: the model equation of the tumble put through the noiseless channel at the positions
that the sequence visits. So K1 contains K3, K2 the converter's asymmetry, and K0 the converter's zero
(methods.md 8.8). A dwell is evaluated at its *indicated* temperature with the hysteresis, drift and warm-up it then
had.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from simulators.world import SimulatedUnit, World


@dataclass(frozen=True, slots=True)
class DwellAsMeasured:
    """What the results say of a dwell: host time of its middle, indicated temperature, and nominal head angles."""

    key: str
    place: str
    at_s: float
    temperature_c: float
    head_deg: tuple[float, ...]


def truth_record(world: World, dwells: Sequence[DwellAsMeasured]) -> dict[str, Any]:
    """The whole truth of a run: the laboratory's errors, each unit as drawn, each dwell's true constants."""
    settings = world.settings
    return {
        "schema": "itb-truth/1",
        "seed": settings.seed,
        "bench": {
            "gravity_mps2": settings.gravity_mps2,
            "host_clock": settings.host_clock,
            "device_clock": settings.device_clock,
            "head": asdict(settings.axis),
            "level_deg": settings.level_deg,
            "thermometers": {
                name: {"offset_c": place.thermometer_offset_c, "gain": place.thermometer_gain}
                for name, place in sorted(settings.places.items())
            },
        },
        "units": {name: asdict(unit.truth) for name, unit in sorted(world.units.items())},
        "dwells": {dwell.key: dict(dwell_truth(world, dwell)) for dwell in dwells},
    }


def dwell_truth(world: World, dwell: DwellAsMeasured) -> Mapping[str, float]:
    """True K0 (g), K1 (pulse/s/g), K1_si (pulse/s per m/s²), K2 (g/g²) and misalignment (rad) of one dwell."""
    unit = world.units[dwell.place]
    angle = np.radians(
        world.settings.fixture.sense * np.array(dwell.head_deg)
        + world.settings.fixture.offset_deg
        + unit.settings.mount_angle_deg
    )
    sine, cosine = np.sin(angle), np.cos(angle)
    rate = _noiseless_rate(world, unit, dwell, angle)
    design = np.stack([np.ones_like(sine), sine, cosine, sine**2], axis=-1)
    c0, k1, cosine_term, c2 = np.linalg.lstsq(design, rate, rcond=None)[0].tolist()
    return {
        "K0": c0 / k1,
        "K1": k1,
        "K1_si": k1 / world.settings.gravity_mps2,
        "K2": c2 / k1,
        "misalignment": cosine_term / k1,
    }


def _noiseless_rate(
    world: World, unit: SimulatedUnit, dwell: DwellAsMeasured, angle: np.ndarray[Any, np.dtype[np.float64]]
) -> np.ndarray[Any, np.dtype[np.float64]]:
    true_s = world.true_time(dwell.at_s)
    times, _, hysteresis = (np.array(column) for column in zip(*unit.history, strict=True))
    extra_g = float(np.interp(true_s, times, hysteresis)) + unit.slow_bias_g(np.array([true_s]))
    force = (np.sin(angle), np.cos(angle), np.zeros_like(angle))
    temperature = np.full_like(angle, dwell.temperature_c)
    return unit.truth.rate_pps(unit.truth.current_a(force, temperature, np.broadcast_to(extra_g, angle.shape)))
