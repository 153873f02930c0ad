"""Profile file of a chamber's controller: addresses and meaning of its registers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, ValidationError, WithJsonSchema, model_validator
from pydantic_core import InitErrorDetails

from drivers.dialects.modbus_chamber.wire import ValueFormat, ValueType
from drivers.kinds.chamber.description import TemperatureRange
from drivers.kinds.chamber.words import WordOrder
from drivers.schema.fields import NOT_EMPTY, InUnit, Number, StrictModel, WholeNumber
from drivers.schema.wording import expected, problem_at

LAST_ADDRESS = 0xFFFF


def _address(raw: object) -> int:
    """Validate a register address, also in the form of manuals: 0x11A9."""
    number = raw
    if isinstance(raw, str) and raw.lower().startswith("0x"):
        try:
            number = int(raw, 16)
        except ValueError:
            number = raw
    if not isinstance(number, int) or isinstance(number, bool) or not 0 <= number <= LAST_ADDRESS:
        raise expected("a register address on the wire, 0 to 65535 or 0x0000 to 0xFFFF", raw)
    return number


RegisterAddress = Annotated[
    int,
    BeforeValidator(_address),
    WithJsonSchema({
        "anyOf": [
            {"type": "integer", "minimum": 0, "maximum": LAST_ADDRESS},
            {"type": "string", "pattern": "^0[xX][0-9a-fA-F]{1,4}$"},
        ]
    }),
]  # fmt: skip
Word = Annotated[WholeNumber, Field(ge=0, le=0xFFFF)]
Meaning = Annotated[str, Field(min_length=1, max_length=80)]
ReadFunction = Literal[3, 4]
WriteFunction = Literal[6, 16]


class CodeRegister(StrictModel):
    """One register that holds a code."""

    address: RegisterAddress = Field(description="address on the wire; the first register is 0")
    read: ReadFunction = Field(3, description="read function: 3 holding, 4 input registers")

    @property
    def count(self) -> int:
        """Number of registers."""
        return 1


class ValueRegister(CodeRegister):
    """One or two registers that hold a number."""

    type: ValueType = Field("int16", description="number format")
    scale: Annotated[Number, Field(gt=0)] = Field(1.0, description="value of one count, such as 0.1 for tenths")
    word_order: WordOrder | None = Field(None, description="of two registers, if different from that of the profile")

    @property
    def count(self) -> int:
        """Number of registers."""
        return ValueFormat(self.type).count


class WrittenRegister(ValueRegister):
    """A register that is written as well as read."""

    write: WriteFunction = Field(6, description="write function; always 16 for two registers")


class Expectation(CodeRegister):
    """A register whose value identifies the controller, or a setting that it must have."""

    is_: Word = Field(alias="is", description="required value")
    means: Meaning = Field(description="its meaning, such as 'the display unit is °C'")


class LimitRegisters(StrictModel):
    """Registers of the lowest and the highest set point."""

    min: ValueRegister
    max: ValueRegister


class ModeRegister(CodeRegister):
    """The register of the control mode; an unlisted number is another mode."""

    follows: Annotated[list[Word], NOT_EMPTY] = Field(description="codes of the modes that follow the set point")
    off: list[Word] = Field([], description="codes of the modes off and idle")
    other: dict[Meaning, Word] = Field({}, description="other modes: name and code")
    start: Word | None = Field(
        None, description="code written to select the set-point mode; without it only a person may do that"
    )
    write: WriteFunction = Field(6, description="the function that writes it")

    @model_validator(mode="after")
    def _numbers_mean_one_thing(self) -> Self:
        listed = [*self.follows, *self.off, *self.other.values()]
        if twice := sorted({number for number in listed if listed.count(number) > 1}):
            raise _refusal(self, [problem_at(("follows",), f"the number {twice[0]} is listed twice")])
        if self.start is not None and self.start not in self.follows:
            raise _refusal(self, [problem_at(("start",), f"is {self.start}, which is none of follows")])
        return self


class Switch(CodeRegister):
    """A register that must hold a number before another setting takes effect."""

    value: Word = Field(description="value to be written")
    write: WriteFunction = Field(6, description="the function that writes it")


class RampRegisters(StrictModel):
    """The controller's own ramp to a set point."""

    rate: WrittenRegister
    per: Literal["minute", "hour"] = Field(description="time unit of the rate")
    on: Switch | None = Field(None, description="register that switches the ramp on, written after the rate")


class AlarmRegister(CodeRegister):
    """A register that reports an alarm."""

    quiet: Annotated[list[Word], NOT_EMPTY] = Field([0], description="value without an alarm")
    means: Meaning = Field(description="name of the alarm, such as 'over-temperature'")


class ChamberProfile(StrictModel):
    """One kind of controller."""

    schema_: Literal["itb-chamber/1"] = Field(alias="schema", description="kind of this file")
    maker: Meaning = Field(description="maker of the controller")
    model: Meaning = Field(description="its name")
    source: Meaning = Field(description="source of these numbers: a manual and its edition, or a test")
    word_order: WordOrder | None = Field(None, description="word order of values in two registers")
    gap: Annotated[float, InUnit("s", at_least=0, at_most=2)] = Field(
        0.03, description="minimum pause between an answer and the next request on a serial line"
    )
    must_be: list[Expectation] = Field([], description="checked at every connection")
    process_value: ValueRegister
    set_point: WrittenRegister
    set_point_in_force: ValueRegister | None = Field(
        None, description="register of the active set point, if it differs during a ramp"
    )
    range: TemperatureRange | None = Field(None, description="range of set points, if no registers hold it")
    limits: LimitRegisters | None = Field(None, description="registers of the range")
    mode: ModeRegister | None = Field(None, description="register of the mode, if the controller has several")
    ramp: RampRegisters | None = Field(
        None, description="registers of the controller's own ramp; without one the driver sends a series of set points"
    )
    alarms: list[AlarmRegister] = Field([], description="read at every poll")

    @model_validator(mode="after")
    def _complete_and_unambiguous(self) -> Self:
        if problems := [*self._missing(), *self._orders(), *self._shared()]:
            raise _refusal(self, problems)
        return self

    def form(self, register: ValueRegister) -> ValueFormat:
        """Format of a value."""
        order = register.word_order or self.word_order or "high_first"
        return ValueFormat(register.type, register.scale, order)

    def registers(self) -> Iterator[tuple[tuple[str | int, ...], CodeRegister]]:
        """All registers with their places in the file."""
        found: dict[tuple[str | int, ...], CodeRegister | None] = {
            ("process_value",): self.process_value,
            ("set_point",): self.set_point,
            ("set_point_in_force",): self.set_point_in_force,
            ("mode",): self.mode,
        }
        found |= {("must_be", index): each for index, each in enumerate(self.must_be)}
        found |= {("alarms", index): each for index, each in enumerate(self.alarms)}
        if self.limits is not None:
            found |= {("limits", "min"): self.limits.min, ("limits", "max"): self.limits.max}
        if self.ramp is not None:
            found |= {("ramp", "rate"): self.ramp.rate, ("ramp", "on"): self.ramp.on}
        return ((place, register) for place, register in found.items() if register is not None)

    def _missing(self) -> Iterator[InitErrorDetails]:
        if (self.range is None) == (self.limits is None):
            yield problem_at((), "needs either range or limits of the set points")
        if self.ramp is not None and self.set_point_in_force is None:
            yield problem_at(("ramp",), "needs set_point_in_force as well, which shows the progress of the ramp")

    def _orders(self) -> Iterator[InitErrorDetails]:
        for place, register in self.registers():
            if isinstance(register, ValueRegister) and register.count == 2 and not (
                register.word_order or self.word_order
            ):  # fmt: skip
                yield problem_at((*place, "type"), f"{register.type} fills two registers: give word_order")

    def _shared(self) -> Iterator[InitErrorDetails]:
        """Registers used for two values; holding and input registers are numbered separately."""
        holders: dict[tuple[int, int], str] = {}
        for place, register in self.registers():
            name = ".".join(map(str, place))
            for address in range(register.address, register.address + register.count):
                if before := holders.get((register.read, address)):
                    yield problem_at((*place, "address"), f"register {address} is used by {before} already")
                    break
                holders[register.read, address] = name


def _refusal(model: StrictModel, problems: Sequence[Any]) -> ValidationError:
    return ValidationError.from_exception_data(type(model).__name__, list(problems))
