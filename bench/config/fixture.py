"""Geometry of the units in a bench file: axes of the table, fixture on it, and mounts of the units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema

from bench.config.devices import CoverageFactor, Text
from drivers.schema.fields import Arcseconds, Date, Degrees, InUnit, Name, Range, StrictModel
from drivers.schema.wording import telling

Vector = tuple[float, float, float]
Compass = Literal["east", "west", "north", "south", "up", "down"]
DIRECTIONS: Mapping[Compass, Vector] = {
    "east": (1.0, 0.0, 0.0),
    "west": (-1.0, 0.0, 0.0),
    "north": (0.0, 1.0, 0.0),
    "south": (0.0, -1.0, 0.0),
    "up": (0.0, 0.0, 1.0),
    "down": (0.0, 0.0, -1.0),
}
"""Unit vectors in the level frame: east, north, up."""

Direction = Literal["level", "up", "down"]


class InputAxis(StrictModel):
    """Orientation of the input axis in the fixture at two angles of the head."""

    at_0: Direction = Field(description="where it points at a head angle of 0°")
    at_90: Direction = Field(description="where it points at 90°")

    @model_validator(mode="after")
    def _turns_in_the_vertical_plane(self) -> InputAxis:
        if (self.at_0 == "level") == (self.at_90 == "level"):
            raise telling("of at_0 and at_90 one is level and the other up or down: the axis turns in a vertical plane")
        return self

    @property
    def sense(self) -> int:
        """+1 if the axis rises with the head angle at the angle where it is level, else -1."""
        rises = self.at_90 == "up" if self.at_0 == "level" else self.at_0 == "down"
        return 1 if rises else -1

    @property
    def offset_deg(self) -> float:
        """Angle of the axis above the horizontal at head angle 0, in degrees."""
        return {"level": 0.0, "up": 90.0, "down": -90.0}[self.at_0]

    def input_deg(self, head_deg: float) -> float:
        """Angle of the axis above the horizontal at a head angle, both in degrees."""
        return self.sense * head_deg + self.offset_deg

    @property
    def points(self) -> Compass:
        """Direction of the positive head axis; east is that of a level input axis at 0°."""
        return "south" if self.sense > 0 else "north"


class TableAxis(StrictModel):
    """Axis of a table with several axes."""

    device: Name = Field(description="the device that drives it")
    points: Compass = Field(description="where its positive end points while the angles of all axes are 0°")


class Body(StrictModel):
    """Orientation of the fixture at axis angles 0°; y completes a right-handed set."""

    x: Compass = Field(description="where its x axis points, the input axis of a unit with one")
    z: Compass = Field(description="where its z axis points, the normal of the seat")

    @model_validator(mode="after")
    def _square(self) -> Body:
        if any(a and b for a, b in zip(DIRECTIONS[self.x], DIRECTIONS[self.z], strict=True)):
            raise telling("x and z are parallel; they must be at right angles")
        return self


class Mount(StrictModel):
    """Orientation in which units are fixed by hand; a plain angle raises the input axis."""

    angle: Degrees = Field(0.0, description="added to the mount angles: by how much the input axis is raised")
    roll: Degrees = Field(0.0, description="then about the input axis; 180° stands the units on their other end")
    clock: Degrees = Field(0.0, description="then about the normal of their seat")

    @model_validator(mode="before")
    @classmethod
    def _an_angle_alone(cls, raw: Any) -> Any:
        return raw if isinstance(raw, Mapping) else {"angle": raw}

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        whole = handler(schema)
        angle = {key: value for key, value in whole["properties"]["angle"].items() if key not in ("default", "title")}
        return {"anyOf": [angle, whole]}


class Level(StrictModel):
    """Deviation of the fixture from level when the head reads level."""

    value: Annotated[float, InUnit("arcsec")] = Field(description="as last measured")
    U: Arcseconds = Field(description="expanded uncertainty")
    k: CoverageFactor = Field(2.0, description="coverage factor of U")
    drift: Arcseconds | None = Field(
        None, description="expanded change from the beginning of a run to its end; a fifth of U if not stated"
    )
    date: Date = Field(description="of the measurement")


class Azimuth(StrictModel):
    """Uncertainty of north: rotation of the table about the vertical against the file."""

    U: Arcseconds = Field(description="expanded uncertainty")
    k: CoverageFactor = Field(2.0, description="coverage factor of U")
    date: Date = Field(description="of the measurement")


class Orthogonality(StrictModel):
    """Deviation from a right angle of each axis of the table to the axis that carries it."""

    U: Arcseconds = Field(description="expanded uncertainty, of each inner axis in two directions")
    k: CoverageFactor = Field(2.0, description="coverage factor of U")
    date: Date = Field(description="of the measurement")


class Skew(StrictModel):
    """Angle between two input axes beyond 90°, in the plane of the tilt."""

    value: Annotated[float, InUnit("rad")] = Field(description="as last measured; positive if it is more than 90°")
    U: Annotated[float, InUnit("rad", at_least=0)] = Field(description="expanded uncertainty")
    k: CoverageFactor = Field(2.0, description="coverage factor of U")
    date: Date = Field(description="of the measurement")


class TiltPair(StrictModel):
    """Two places whose accelerometers measure a tilt together, over the full circle."""

    along: Name = Field(description="the place of the accelerometer whose tilt it is")
    across: Name = Field(description="the place of the one that is up when that is level: its mount angle is 90° more")
    skew: Skew


class AngleRange(Range):
    """Angles of the head from `min` to `max`, modulo a turn."""

    min: Degrees
    max: Degrees


class FixtureEntry(StrictModel):
    """Fixture that holds the units on the head."""

    serial: Text = Field(description="serial number of the fixture")
    input_axis: InputAxis | None = Field(None, description="of units on a head with one level axis")
    axes: tuple[TableAxis, ...] = Field((), description="of any other table, the outermost first; give body as well")
    body: Body | None = None
    level: Level
    azimuth: Azimuth | None = None
    orthogonality: Orthogonality | None = None
    mounts: Mapping[Name, Mount] = Field(
        {}, description="ways in which units can be fixed by hand; a run begins with the first"
    )
    tilt_pairs: tuple[TiltPair, ...] = Field(
        (), description="accelerometers at right angles whose common tilt is verified with their calibrations"
    )
    forbidden: tuple[AngleRange, ...] = Field((), description="angles of the head at which something would collide")

    @model_validator(mode="after")
    def _one_geometry(self) -> FixtureEntry:
        if (self.input_axis is None) == (self.body is None):
            raise telling(
                "give the orientation of the units: input_axis on a head with a level axis, else body (and axes)"
            )
        if self.axes and self.body is None:
            raise telling("axes need a body: where x and z of the fixture point")
        return self

    @property
    def x(self) -> Vector:
        """Direction of the x axis of the fixture at axis angles 0°."""
        if self.body is not None:
            return DIRECTIONS[self.body.x]
        raised = math.radians(self.input_axis.offset_deg if self.input_axis is not None else 0.0)
        return math.cos(raised), 0.0, math.sin(raised)

    @property
    def z(self) -> Vector:
        """Direction of the z axis of the fixture at axis angles 0°."""
        if self.body is not None:
            return DIRECTIONS[self.body.z]
        east, _, up = self.x
        return -up, 0.0, east

    def mount(self, name: str | None = None) -> Mount:
        """Return a mount by its name; without a name the first one, or the default mount."""
        return self.mounts[name] if name is not None else next(iter(self.mounts.values()), Mount())
