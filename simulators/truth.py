"""What a perfect bench would have found: the channel's true constants, for the file that no reduction reads.

They are defined as the results are: the model equation of the tumble put through the noiseless channel at the positions
that the sequence visits. So K1 contains K3, K2 the converter's asymmetry, and K0 the converter's zero
(methods.md 8.8). A dwell is evaluated at its *indicated* temperature with the hysteresis, drift and warm-up it then
had.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from simulators.uut import UnitTruth
from simulators.world import World


@dataclass(frozen=True, slots=True)
class DwellAsMeasured:
    """What the results say of a dwell: host time of its middle, indicated temperature, nominal angles.

    Those of the head, and what the mount of the fixture added, each for every reading.
    """

    key: str
    place: str
    at_s: float
    temperature_c: float
    head_deg: tuple[float, ...]
    mounted_deg: tuple[float, ...]


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
        "dwells": {dwell.key: _dwell(world, dwell) for dwell in dwells},
    }


def _dwell(world: World, dwell: DwellAsMeasured) -> dict[str, Any]:
    """The state of a unit in the middle of a dwell, and its constants then."""
    unit, settings = world.units[dwell.place], world.settings
    true_s = world.true_time(dwell.at_s)
    times, added_g = np.array(unit.bias_history).T
    drifted_g = float(np.interp(true_s, times, added_g))
    fixed_deg = settings.fixture.offset_deg + unit.settings.mount_angle_deg
    axis_deg = tuple(
        settings.fixture.sense * head_deg + fixed_deg + mounted_deg
        for head_deg, mounted_deg in zip(dwell.head_deg, dwell.mounted_deg, strict=True)
    )
    constants = channel_constants(unit.truth, settings.gravity_mps2, axis_deg, dwell.temperature_c, drifted_g)
    return {"temperature_c": dwell.temperature_c, "drifted_g": drifted_g, "axis_deg": axis_deg, **constants}


def channel_constants(
    truth: UnitTruth, gravity_mps2: float, axis_deg: Sequence[float], temperature_c: float, drifted_g: float
) -> dict[str, float]:
    """True K0 (g), K1 (pulse/s/g), K1_si (pulse/s per m/s²), K2 (g/g²) and misalignment (rad) of a channel.

    `axis_deg` are the ideal angles of the input axis above the horizontal, `drifted_g` what hysteresis, drift and
    warm-up add to the bias.
    """
    angle = np.radians(np.array(axis_deg))
    sine, cosine = np.sin(angle), np.cos(angle)
    force = (sine, cosine, np.zeros_like(angle))
    current = truth.current_a(force, np.full_like(angle, temperature_c), np.full_like(angle, drifted_g))
    design = np.stack([np.ones_like(sine), sine, cosine, sine**2], axis=-1)
    solution: list[float] = np.linalg.lstsq(design, truth.rate_pps(current), rcond=None)[0].tolist()
    c0, k1, cosine_term, c2 = solution
    return {"K0": c0 / k1, "K1": k1, "K1_si": k1 / gravity_mps2, "K2": c2 / k1, "misalignment": cosine_term / k1}
