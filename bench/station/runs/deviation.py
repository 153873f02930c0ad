"""Deviation of pulse rates from what the bench file lets expect of a unit at rest, for curves.

The expectation is the nominal change of the output for 1 g, times the part of gravity along the input axis at the angle
to which the head was moved: S·K1·sin(elevation). It is for units on a head with one level axis whose nominal scale
factor is in the bench file, while the head stands still and no source feeds the converter; elsewhere there is none.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from bench.config.bench import load_kept_bench
from bench.config.fixture import InputAxis
from bench.reduce.stored_run import BENCH_COPY
from bench.store.tail import Bucket, Tail

DEVIATION = ".deviation"  # added to the name of a channel


class Expectation(NamedTuple):
    """What is expected of the unit in a place: `per_g` in pulse/s for 1 g, raised by `own_deg` in its fixture.

    `mounts_deg` are angles by which the ways of mounting raise it, the first one at the beginning of a run.
    """

    place: str
    head: str
    source: str | None
    axis: InputAxis
    own_deg: float
    per_g: float
    mounts_deg: Mapping[str, float]

    def at(self, head_deg: float, mount: str | None) -> float:
        """Return the expected pulse rate at an angle of the head, in pulse/s."""
        mounted = self.mounts_deg.get(mount or next(iter(self.mounts_deg), ""), 0.0)
        return self.per_g * math.sin(math.radians(self.axis.input_deg(head_deg) + mounted + self.own_deg))


@lru_cache(maxsize=32)  # the copy of the bench file in a run does not change
def expectations(run: Path) -> Mapping[str, Expectation]:
    """Return the expectation of each channel, as DEVICE.CHANNEL, of the bench of a run. Raises InputError."""
    bench = load_kept_bench(run / BENCH_COPY)
    axis, heads = bench.fixture.input_axis, bench.with_capability("positioner")
    if axis is None or not heads or any(mount.clock for mount in bench.fixture.mounts.values()):
        return {}
    mounts = {name: mount.angle for name, mount in bench.fixture.mounts.items()}
    return {
        f"{bench.measured_by(name)}.{entry.channel}": Expectation(
            name, heads[0], entry.source, axis, entry.mount_angle, per_g, mounts
        )
        for name, entry in bench.places.items()
        if entry.channel and (per_g := bench.nominal_per_g(name)) is not None
    }


def deviation(tail: Tail, expected: Expectation, rates: Sequence[Bucket], width_s: float) -> list[Bucket]:
    """Return pulse rates minus their expectation; intervals without one are left out."""
    course = list(_course(tail, expected))
    begins = [at_s for at_s, _ in course]
    found = []
    for each in rates:
        place = bisect_right(begins, each.at_s + width_s) - 1
        rate = course[place][1] if place >= 0 else None
        if rate is not None:
            found.append(Bucket(each.at_s, each.low - rate, each.high - rate, each.mean - rate))
    return found


def _course(tail: Tail, expected: Expectation) -> Iterator[tuple[float, float | None]]:
    """Yield what is expected from an instant on, as the journal has it: None while the head moves or a source is on."""
    named = [tail.steps_with(json) for json in (f'"{expected.head}"', f'"{expected.source}"', '"mount"')]
    events = {each.seq: each for found in named for each in found}
    angle_deg: float | None = None
    mount: str | None = None
    is_fed = False
    for _, event in sorted(events.items()):
        data = event.data
        if data.get("device") == expected.head:
            read = data.get("angle_deg") if event.kind == "step_ended" else None
            angle_deg = float(read) if isinstance(read, (int, float)) else None
        if expected.source is not None and expected.source in (data.get("device"), data.get("role")):
            is_fed = data.get("output") not in ("off", False)
        if event.kind == "step_ended" and data.get("mount"):
            mount = str(data["mount"])
        yield event.at_s, None if angle_deg is None or is_fed else expected.at(angle_deg, mount)
