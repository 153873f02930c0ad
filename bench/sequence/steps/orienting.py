"""Attitudes: directions of the axes of a unit, and the table angles that give them (equations 4.2, 8.1).

Everything is in quarter turns: axes of tables and attitudes point along the compass directions or the vertical, and
mounts must. The frame is east, north, up; vectors and the rows of matrices are whole numbers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from itertools import product
from typing import Annotated, Any, ClassVar, NamedTuple

from pydantic import Field, PlainValidator, WithJsonSchema

from bench.config.fixture import DIRECTIONS
from bench.config.models import BenchFile
from bench.metrology.attitude_names import ATTITUDES
from bench.sequence.steps.fields import Resumed, StepBase
from drivers.capabilities import Approach
from drivers.quantity.units import quoted
from drivers.schema.fields import Seconds, is_deferred
from drivers.schema.suggest import did_you_mean
from drivers.schema.wording import expected, telling

Row = tuple[int, int, int]
Rows = tuple[Row, Row, Row]
Quarters = tuple[int, ...]

AXES = ("x", "y", "z")
QUARTER_DEG = 90.0
TURN_DEG = 360.0
SAME_DEG = 1e-6
_UNITS: Rows = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
_WORDS: Mapping[str, Row] = {
    name: (round(east), round(north), round(up)) for name, (east, north, up) in DIRECTIONS.items()
}
_LETTERS: Mapping[str, Row] = {name[0].upper(): row for name, row in _WORDS.items()}
_SCHEMA = {
    "anyOf": [
        {"type": "string", "minLength": 1},
        {"type": "object", "properties": {axis: {"type": "string"} for axis in AXES}, "additionalProperties": False},
    ],
    "description": "{x: up, y: east}, the letters of x, y and z as UEN, or a name such as Ax1",
}


class Attitude(NamedTuple):
    """Directions of the axes x, y and z of a unit; None while they depend on a measurement."""

    rows: Rows | None

    def __str__(self) -> str:
        letters = {row: letter for letter, row in _LETTERS.items()}
        return "".join(letters[row] for row in self.rows or ())

    @property
    def name(self) -> str:
        """Its letters, and its name if it is one of the 24."""
        known = {letters: name for name, letters in ATTITUDES.items()}
        return f"{known[str(self)]} ({self})" if str(self) in known else str(self)


def _attitude(raw: Any, info: Any) -> Attitude:
    if isinstance(raw, Attitude):
        return raw
    if isinstance(raw, Mapping):
        return Attitude(_of_axes(raw))
    if not isinstance(raw, str) or not raw:
        raise expected("an attitude like {x: up, y: east}", raw)
    if "${" in raw and is_deferred(info.context):
        return Attitude(None)
    letters = ATTITUDES.get(raw, raw.upper())
    if len(letters) == len(AXES) and all(letter in _LETTERS for letter in letters):
        return Attitude(_right_handed(tuple(_LETTERS[letter] for letter in letters)))
    raise telling(f"there is no attitude {quoted(raw)}, write {{x: up, y: east}} or UEN{did_you_mean(raw, ATTITUDES)}")


def _of_axes(raw: Mapping[str, Any]) -> Rows:
    """Parse two or three axes with their directions."""
    for axis, direction in raw.items():
        if axis not in AXES:
            raise telling(f"a unit has no axis {quoted(axis)}; its axes are x, y and z")
        if _direction(direction) is None:
            raise telling(f"{axis} points {quoted(direction)}; write up, down, north, south, east or west")
    given = {axis: _direction(direction) for axis, direction in raw.items()}
    if len(given) < 2:
        raise telling("give the directions of two axes; the third follows")
    x, y, z = (given.get(axis) for axis in AXES)
    if x is None and y is not None and z is not None:
        x = _cross(y, z)
    elif y is None and x is not None and z is not None:
        y = _cross(z, x)
    elif z is None and x is not None and y is not None:
        z = _cross(x, y)
    return _right_handed((x or _UNITS[0], y or _UNITS[1], z or _UNITS[2]))


def _direction(word: Any) -> Row | None:
    text = str(word)
    return _WORDS.get(text.lower()) or _LETTERS.get(text.upper())


def _right_handed(rows: tuple[Row, ...]) -> Rows:
    x, y, z = rows
    if any(map(_dot, (x, y, z), (y, z, x))):
        raise telling("the axes are not at right angles to one another")
    if _cross(x, y) != z:
        raise telling("the axes are left-handed: x, y, z point like thumb, forefinger, middle finger of the right hand")
    return x, y, z


class Orient(StepBase):
    """Turn the axes of the table so that the axes of the units have the given directions, by the shortest way.

    Orientation of a mounted unit: x is its input axis, z the normal of its seat. Two axes are enough. An attitude that
    the table cannot reach with the units as mounted is an error before the run.
    """

    resumed: ClassVar[Resumed] = "restored"

    attitude: Annotated[Attitude, PlainValidator(_attitude), WithJsonSchema(_SCHEMA)] = Field(
        alias="orient", description="directions of the axes: up, down, north, south, east, west"
    )
    approach: Approach = Field("direct", description="the side from which each axis reaches its angle")
    settle_s: Seconds = Field(0.0, alias="settle", description="dwell after all axes have settled")

    @property
    def least_s(self) -> float:
        """Settling time."""
        return self.settle_s


class Pose(NamedTuple):
    """Angles of the axes of a bench, by role, and the name of the mount; None for the initial mount."""

    angles_deg: Mapping[str, float] = {}
    mount: str | None = None


class Unreachable(Exception):
    """An attitude that the axes cannot reach, with the reason."""


class Turning:
    """Axes of a bench that turn its units to attitudes; what the bench alone decides is worked out once."""

    def __init__(self, bench: BenchFile) -> None:
        self._bench = bench
        self._axes = bench.axes
        self._ends_deg = tuple(_ends_deg(bench, role) for role in self._axes)
        self._reached: dict[str | None, Mapping[Rows, tuple[Quarters, ...]]] = {}  # by mount

    def targets_deg(self, attitude: Attitude, pose: Pose) -> dict[str, float]:
        """The target angle of each axis, outer first, by the shortest way from its present angle.

        Raises Unreachable.
        """
        if attitude.rows is None:
            raise Unreachable("its attitude is not known")
        reached = self._reachable(pose.mount)
        from_deg = tuple(pose.angles_deg.get(role, 0.0) for role in self._axes)
        if best := _shortest(reached.get(attitude.rows, ()), from_deg, self._ends_deg):
            return dict(zip(self._axes, best, strict=True))
        axes = " and ".join(self._axes)
        if attitude.rows in reached:
            raise Unreachable(f"{attitude.name} is beyond the angles that the bench file allows {axes}")
        mounts = self._bench.fixture.mounts
        mount = f" in mount '{pose.mount or next(iter(mounts))}'" if mounts else ""
        raise Unreachable(
            f"{attitude.name} cannot be reached by {axes or 'no axis'}{mount}: {len(reached)} of 24 attitudes can"
        )

    def _reachable(self, mount: str | None) -> Mapping[Rows, tuple[Quarters, ...]]:
        if mount not in self._reached:
            unit = _unit_at_zero(self._bench, mount)
            self._reached[mount] = reachable(tuple(map(_whole, self._axes.values())), unit)
        return self._reached[mount]


@lru_cache(maxsize=1024)  # checks, estimates and runs ask for the same ways again and again
def _shortest(
    ways: tuple[Quarters, ...], from_deg: tuple[float, ...], ends_deg: tuple[tuple[float, float], ...]
) -> tuple[float, ...]:
    """Angles of the axes after the shortest of several ways; empty if none is within the ends."""
    best: tuple[float, ...] = ()
    least = (math.inf, math.inf)
    for quarters in ways:
        found = tuple(
            _nearest(quarter * QUARTER_DEG, begun_deg, ends)
            for quarter, begun_deg, ends in zip(quarters, from_deg, ends_deg, strict=True)
        )
        way_deg = math.fsum(abs(angle_deg - begun_deg) for angle_deg, begun_deg in zip(found, from_deg, strict=True))
        # of equally long ways, the one nearer to zero turns
        cost = (round(way_deg, 6), math.fsum(map(abs, found)))
        if cost < least:
            best, least = found, cost
    return best


@lru_cache(maxsize=32)
def reachable(axes: tuple[Row, ...], unit: Rows) -> Mapping[Rows, tuple[Quarters, ...]]:
    """Attitudes that a table reaches, with the quarter turns of its axes; `unit` is the orientation at angles of 0."""
    found: dict[Rows, list[Quarters]] = {}
    for quarters in product(range(4), repeat=len(axes)):
        x, y, z = unit
        for axis, quarter in reversed([*zip(axes, quarters, strict=True)]):  # the innermost axis first
            x, y, z = (_turned(row, axis, quarter) for row in (x, y, z))
        found.setdefault((x, y, z), []).append(quarters)
    return {rows: tuple(ways) for rows, ways in found.items()}


def _unit_at_zero(bench: BenchFile, mount_name: str | None) -> Rows:
    """Directions of the units' axes at angles of 0; Unreachable if not by quarter turns.

    An unknown mount is reported where it is named, and counts as the first one here.
    """
    fixture = bench.fixture
    mount = fixture.mount(mount_name if mount_name in fixture.mounts else None)
    own = {(place.mount_angle, place.clock) for place in bench.places.values()}
    if len(own) > 1:
        raise Unreachable("the units are oriented differently in their places: their mount angles are not the same")
    x, z = _whole(fixture.x), _whole(fixture.z)
    raised_deg, clocked_deg = next(iter(own))
    turns_deg = [
        ("y", -mount.angle), ("x", mount.roll), ("z", mount.clock), ("y", -raised_deg), ("z", clocked_deg),
    ]  # fmt: skip
    rows: Rows = (x, _cross(z, x), z)
    for axis, angle_deg in turns_deg:
        quarters = angle_deg / QUARTER_DEG
        if abs(quarters - round(quarters)) > SAME_DEG:
            raise Unreachable("the units are not mounted by quarter turns, so that their axes point between directions")
        about = rows[AXES.index(axis)]
        a, b, c = (_turned(row, about, round(quarters)) for row in rows)
        rows = (a, b, c)
    return rows


def _ends_deg(bench: BenchFile, role: str) -> tuple[float, float]:
    allowed: Any = getattr(bench.devices[role].limits, "angle", None)
    low, high = getattr(allowed, "min", None), getattr(allowed, "max", None)
    return -math.inf if low is None else low, math.inf if high is None else high


def _nearest(target_deg: float, from_deg: float, ends_deg: tuple[float, float]) -> float:
    """Angle equal to `target_deg` modulo whole turns that is nearest and within the ends; NaN if none is."""
    low_deg, high_deg = ends_deg
    turns = round((from_deg - target_deg) / TURN_DEG)
    candidates = [target_deg + (turns + k) * TURN_DEG for k in (0, -1, 1, -2, 2)]
    allowed = [angle_deg for angle_deg in candidates if low_deg <= angle_deg <= high_deg]
    return min(allowed, key=lambda deg: (round(abs(deg - from_deg), 6), abs(deg)), default=math.nan)


def _whole(vector: tuple[float, float, float]) -> Row:
    east, north, up = map(round, vector)
    return east, north, up


def _turned(vector: Row, axis: Row, quarters: int) -> Row:
    """A vector after quarter turns about an axis (Rodrigues)."""
    cosine, sine = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarters % 4]
    across, along = _cross(axis, vector), _dot(axis, vector) * (1 - cosine)
    a, b, c = (cosine * v + sine * w + along * k for v, w, k in zip(vector, across, axis, strict=True))
    return a, b, c


def _cross(a: Row, b: Row) -> Row:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _dot(a: Row, b: Row) -> int:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
