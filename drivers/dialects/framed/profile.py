"""Profile file of the frames of a table or a head: layout, and meaning of numbers."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationError, model_validator
from pydantic_core import InitErrorDetails

from drivers.dialects.framed.parts import (
    AccelerationNumber,
    AmplitudeNumber,
    AngleNumber,
    Bit,
    ChecksumSettings,
    Code,
    Constant,
    Count,
    Fault,
    FrequencyNumber,
    HexBytes,
    LineSettings,
    Number,
    Place,
    RateNumber,
)
from drivers.dialects.framed.wire import ByteOrder, FrameFormat, NumberFormat
from drivers.kinds.axes import RateRange
from drivers.kinds.head.description import AngleRange
from drivers.schema.fields import Flag, InUnit, StrictModel, WholeNumber
from drivers.schema.wording import problem_at

Meaning = Annotated[str, Field(min_length=1, max_length=80)]
Where = tuple[str | int, ...]


class FrameShape(StrictModel):
    """Common keys of all frames; undescribed bytes are sent as 0, and ignored on reception."""

    length: Annotated[WholeNumber, Field(ge=3, le=256)] = Field(description="length in bytes, with header and checksum")
    header: HexBytes | None = Field(None, description="if different from that of the profile")
    constants: list[Constant] = Field([], description="constant bytes, such as a kind of frame")
    counter: Count | None = Field(None, description="sequence number, rises by one from frame to frame")

    def parts(self) -> Iterator[tuple[Where, Place]]:
        """Parts of the frame, with their places in the file."""
        for name in type(self).model_fields:
            found = getattr(self, name)
            if isinstance(found, Place):
                yield (name,), found
            elif isinstance(found, list):
                yield from (((name, index), each) for index, each in enumerate(found))
            elif isinstance(found, StrictModel):
                inner = ((key, getattr(found, key)) for key in type(found).model_fields)
                yield from (((name, key), each) for key, each in inner if isinstance(each, Place))


class MoveFrame(FrameShape):
    """Move to an angle."""

    angle: AngleNumber
    rate: RateNumber | None = Field(
        None, description="rate of the move; without it the controller's own setting applies"
    )
    acceleration: AccelerationNumber | None = None


class RateFrame(FrameShape):
    """Rotate at a rate."""

    rate: RateNumber
    acceleration: AccelerationNumber | None = None


class SineFrame(FrameShape):
    """Oscillate about the present angle."""

    amplitude: AmplitudeNumber
    frequency: FrequencyNumber


class Commands(StrictModel):
    """Commands to the controller. The driver never sends `home`, `clear_fault` and `disable`; other programs may."""

    stop: FrameShape = Field(description="decelerates and holds")
    move: MoveFrame
    enable: FrameShape | None = Field(None, description="energises the motor")
    disable: FrameShape | None = None
    rate: RateFrame | None = Field(None, description="for a rate table")
    sine: SineFrame | None = Field(None, description="for a rate table with an oscillation command")
    home: FrameShape | None = None
    clear_fault: FrameShape | None = None


class States(StrictModel):
    """State bits of the axis."""

    moving: Bit = Field(description="the axis moves: to an angle, at a rate, in a sine, or decelerating")
    enabled: Bit | None = Field(None, description="the motor is energised; without it, it always is")
    homed: Bit | None = Field(None, description="the axis is homed; without it, it always is")
    in_position: Bit | None = Field(None, description="it is at its target")
    at_sine: Bit | None = Field(None, description="a sine has its full amplitude")
    remote: Bit | None = Field(None, description="commands on this line are executed; without it, they always are")
    emergency_stop: Bit | None = Field(None, description="the emergency stop is pressed")


class StatusFrame(FrameShape):
    """Status of the controller."""

    angle: AngleNumber
    rate: RateNumber | None = Field(None, description="needed of a rate table")
    target_angle: AngleNumber | None = Field(None, description="angle of the last accepted move")
    target_rate: RateNumber | None = Field(None, description="rate of the last accepted `rate`")
    answers: Count | None = Field(None, description="counter of the answered request")
    serial_number: Count | None = Field(None, description="compared with the bench file")
    firmware: Count | None = Field(None, description="compared with the bench file")
    mode: Code | None = Field(None, description="servo mode")
    states: States
    faults: list[Fault] = Field([], description="faults with their names")


class Cycle(StrictModel):
    """Cyclic transmission of the status by the controller."""

    period: Annotated[float, InUnit("s", above=0, at_most=1)] = Field(description="period of the status")


class ControllerLimits(StrictModel):
    """Limits of the axis and its controller; those of the bench file apply as well."""

    angle: AngleRange | None = Field(None, description="of moves, as encoded in their frame")
    rate: RateRange | None = Field(None, description="of moves and of turning")


class FrameProfile(StrictModel):
    """One kind of controller."""

    schema_: Literal["itb-table/1"] = Field(alias="schema", description="kind of this file")
    maker: Meaning = Field(description="maker of the controller")
    model: Meaning = Field(description="its name")
    source: Meaning = Field(description="source of these numbers: a document and its edition, or a test")
    line: LineSettings = Field(LineSettings(), description="of a serial line, unless given in the address")
    byte_order: ByteOrder = Field(description="byte order of numbers of more than one byte")
    header: HexBytes = Field(description="the bytes that every frame begins with")
    trailer: HexBytes = Field(b"", description="the bytes after every checksum")
    checksum: ChecksumSettings
    cyclic: Cycle | None = Field(None, description="for a controller that sends its status unsolicited")
    request: FrameShape | None = Field(None, description="for a controller that is polled: the request frame")
    commands_answered: Flag = Field(False, description="true if commands are answered with a status, too")
    gap: Annotated[float, InUnit("s", at_least=0, at_most=2)] = Field(
        0.0, description="minimum pause between two frames to the controller"
    )
    reaction: Annotated[float, InUnit("s", at_least=0, at_most=2)] = Field(
        description="time after a command in which a status may still be an earlier one"
    )
    angle_wraps: Flag = Field(
        False, description="angles wrap after a turn, and moves take the shorter way; for rate tables only"
    )
    limits: ControllerLimits = Field(ControllerLimits(), description="limits of the motions that are sent")
    status: StatusFrame
    commands: Commands

    @model_validator(mode="after")
    def _complete_and_unambiguous(self) -> Self:
        if problems := [*self._missing(), *self._misplaced(), *self._alike()]:
            raise ValidationError.from_exception_data(type(self).__name__, problems)
        return self

    def number(self, number: Number | Count | Code) -> NumberFormat:
        """Number format of a part."""
        return number.form(self.byte_order)

    def shape(self, name: str) -> FrameShape:
        """Frame by its place in the file: `status`, `request` or the name of a command."""
        return self._shapes[name]

    def format(self, name: str) -> FrameFormat:
        """Frame format for the codec."""
        return self._formats[name]

    def command_names(self) -> list[str]:
        """Names of the available commands."""
        return [name for name in Commands.model_fields if getattr(self.commands, name) is not None]

    def fingerprint(self) -> str:
        """Features that distinguish its frames from others, as far as the profile describes them."""
        status = self.format("status")
        fixed = ", ".join(f"{data.hex(' ').upper()} at {at}" for at, data in status.fixed)
        return f"frames of {status.length} bytes with {fixed}, {self.checksum.kind}"

    @cached_property
    def _formats(self) -> dict[str, FrameFormat]:
        checksum, found = self.checksum.of(self.byte_order), {}
        for name, shape in self._shapes.items():
            fixed = [(0, shape.header or self.header), *((each.at, each.bytes) for each in shape.constants)]
            found[name] = FrameFormat(name, shape.length, tuple(fixed), checksum, self.trailer)
        return found

    @cached_property
    def _shapes(self) -> dict[str, FrameShape]:
        shapes = {name: getattr(self.commands, name) for name in self.command_names()}
        return shapes | {"status": self.status} | ({"request": self.request} if self.request is not None else {})

    def _missing(self) -> Iterator[InitErrorDetails]:
        if (self.cyclic is None) == (self.request is None):
            yield problem_at((), "needs either cyclic or request for its status")
        if self.cyclic is not None and (baud := self.line.baud) is not None:
            duration_s = self.status.length * self.line.bits_per_byte / baud
            if duration_s > self.cyclic.period:
                yield problem_at(("cyclic", "period"), f"a status takes {duration_s * 1000:.3g} ms at {baud} baud")
        if self.cyclic is not None and self.commands_answered:
            yield problem_at(("commands_answered",), "is for a controller that is polled")
        if self.status.answers is not None and (self.request is None or self.request.counter is None):
            yield problem_at(("status", "answers"), "needs request.counter, which it answers with")
        if self.commands.enable is not None and self.status.states.enabled is None:
            yield problem_at(("commands", "enable"), "needs status.states.enabled, which shows its effect")
        if self.commands.sine is not None and self.status.states.at_sine is None:
            yield problem_at(("commands", "sine"), "needs status.states.at_sine, which shows its effect")

    def _misplaced(self) -> Iterator[InitErrorDetails]:
        """Parts that overlap, or extend beyond the end of their frame."""
        for name, shape in self._shapes.items():
            at: Where = (name,) if name in ("status", "request") else ("commands", name)
            form = self.format(name)
            end, header = form.checksum_at, shape.header or self.header
            if end < max(len(header), self.checksum.from_):
                yield problem_at(
                    (*at, "length"), f"{shape.length} bytes are too short for header, checksum and trailer"
                )
                continue
            holders: dict[int, str] = dict.fromkeys(range(len(header)), "the header")
            for where, part in shape.parts():
                yield from _settle(holders, (*at, *where), part, end)

    def _alike(self) -> Iterator[InitErrorDetails]:
        """Command frames that cannot be distinguished."""
        seen: dict[tuple[int, frozenset[tuple[int, int]]], str] = {}
        for name in (each for each in self._shapes if each != "status"):
            form = self.format(name)
            bytes_at = frozenset((at + index, byte) for at, data in form.fixed for index, byte in enumerate(data))
            if before := seen.get((form.length, bytes_at)):
                at = ("request",) if name == "request" else ("commands", name)
                yield problem_at(at, f"it cannot be distinguished from {before}: give it constants")
            seen[form.length, bytes_at] = name


def _settle(holders: dict[int, str], where: Where, part: Place, end: int) -> Iterator[InitErrorDetails]:
    """Assign a part to its bytes; bits may share theirs with other bits."""
    name = ".".join(map(str, where[1:]))
    mark = "bits" if part.shares else name
    for place in range(part.at, part.at + part.count):
        before = holders.setdefault(place, mark)
        if place >= end:
            yield problem_at((*where, "at"), f"byte {place} is beyond the last before the checksum, {end - 1}")
            return
        if before != mark:
            yield problem_at((*where, "at"), f"byte {place} is used by {before} already")
            return
