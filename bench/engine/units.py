"""The remaining units of a run, and the distinction between a failure of one of several units and one of the bench.

In a run of one unit every problem ends the run, like one of the bench.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from functools import lru_cache
from typing import Literal, NamedTuple

from bench.config.models import BenchFile
from bench.config.places import PlaceEntry
from bench.metrology.acquisition import Mount
from bench.metrology.bench_uncertainty import Vector
from bench.metrology.orientation import turned_axes
from drivers.values import LastSeen

Kind = Literal["thermometer", "temperature", "silent", "draws_too_much", "draws_too_little", "not_settled"]
SILENT_S = 5.0  # time without a frame of its channel, beyond the interval of blocks
STANDING_S = 20.0  # time without a pulse
SURE_INPUT_G = 0.015  # along the input axis: more than bias, misalignment and dead band together can cancel


class UnitFailure(NamedTuple):
    """Reason why a unit takes no further part. Only a current above its window proves that the unit itself is bad."""

    place: str
    kind: Kind
    text: str

    @property
    def unit_is_bad(self) -> bool:
        """True if the unit itself has failed, rather than its connection to the bench."""
        return self.kind == "draws_too_much"


class Units:
    """The units of a run by place, and those that have been dropped.

    `places` are those with a unit in them; None for all. `angles_deg` are the known angles of the axes, by
    role, and `mount` is the present mount; the engine updates both.
    """

    def __init__(self, bench: BenchFile, places: Collection[str] | None = None) -> None:
        self._bench = bench
        self.places = {name: entry for name, entry in bench.places.items() if places is None or name in places}
        self.angles_deg: Mapping[str, float] = {}
        self.mount = bench.fixture.mount()
        self._dropped: dict[str, UnitFailure] = {}
        # angles at the last poll, and the time since which they are constant
        self._stood: tuple[tuple[float | None, ...], float] = ((), 0.0)

    @property
    def several(self) -> bool:
        """True if the run began with more than one unit."""
        return len(self.places) > 1

    @property
    def left(self) -> dict[str, PlaceEntry]:
        """Units that remain."""
        return {name: entry for name, entry in self.places.items() if name not in self._dropped}

    def take_over(self, dropped: Iterable[UnitFailure], mount: str | None) -> None:
        """Continue with the units and the mount of the run before its interruption."""
        for failure in dropped:
            self.drop(failure)
        if mount is not None:
            self.mount = self._bench.fixture.mount(mount)

    def drop(self, failure: UnitFailure) -> None:
        """Remove a unit from those that remain."""
        self._dropped.setdefault(failure.place, failure)

    def at(self, name: str) -> list[str]:
        """Places, of all places of the bench, that a supply, a source or a thermometer belongs to."""
        return [place for place, entry in self._bench.places.items() if name in entry.dependencies]

    def is_needed(self, name: str) -> bool:
        """True if a supply, a source or a reading belongs to a remaining unit, or to none in particular."""
        places = self.at(name)
        return not places or any(place in self.left for place in places)

    def members(self, name: str) -> list[str]:
        """Members of a name in the sequence, without those of absent units."""
        return [member for member in self._bench.members(name) if self.is_needed(member)]

    def sole_unit(self, name: str) -> str | None:
        """The only unit that a supply or a reading belongs to, if the run has several."""
        places = [place for place in self.at(name) if place in self.places]
        return places[0] if self.several and len(places) == 1 else None

    def silence(self, place: str, seen: LastSeen, on_since_s: float, now_s: float, late_s: float) -> str:
        """Evidence that a unit under power has become silent; empty if there is none.

        `late_s` is the possible delay of frames. Constant counts are evidence only where the input axis is far enough
        from level, because there any unit gives pulses. They are none for a unit whose converter is fed by a source, or
        for one that sends codes.
        """
        entry = self._bench.places[place]
        channel = entry.telemetry or entry.channel
        quiet_s = now_s - max(seen.frame_s, on_since_s)
        if quiet_s > SILENT_S + late_s:
            return f"no frame of its channel '{channel}' for {quiet_s:.0f} s, while those of other units arrive."
        standing_s = now_s - max(seen.change_s, on_since_s, self._standing_since_s(now_s))
        if self._must_pulse(place) and standing_s > STANDING_S + late_s:
            return f"its count on channel '{channel}' has not changed for {standing_s:.0f} s under power."
        return ""

    def _standing_since_s(self, now_s: float) -> float:
        """Time since which the table has been at its present angle, from polls."""
        angles_deg = tuple(self.angles_deg.get(role) for role in self._bench.axes)
        if angles_deg != self._stood[0]:
            self._stood = (angles_deg, now_s)
        return self._stood[1]

    def _must_pulse(self, place: str) -> bool:
        bench, entry = self._bench, self._bench.places[place]
        if entry.source is not None or not entry.is_counted or any(role not in self.angles_deg for role in bench.axes):
            return False
        turns = tuple((points, self.angles_deg[role]) for role, points in bench.axes.items())
        mount = Mount("", self.mount.angle, self.mount.roll, self.mount.clock)
        own_deg = entry.mount_angle, entry.clock
        return abs(_input_g(turns, bench.fixture.x, bench.fixture.z, mount, own_deg)) > SURE_INPUT_G


@lru_cache(maxsize=64)
def _input_g(
    turns: tuple[tuple[Vector, float], ...], x: Vector, z: Vector, mount: Mount, own_deg: tuple[float, float]
) -> float:
    """Gravity along the input axis, cached because it is queried repeatedly while a table is at rest."""
    return float(turned_axes(turns, x, z, mount, own_deg)[0, 2])
