"""Bench file keys of the telemetry of units under test on CAN."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, ValidationError, model_validator
from pydantic_core import InitErrorDetails

from drivers.can.dbc_outline import lengths_bits
from drivers.can.options import (
    DbcOptions,
    PositionOptions,
    SignalName,
    encoder_signals,
    signals_of,
    text_of,
    unknown_signals,
)
from drivers.can.sent_frames import CODE, Sampled
from drivers.quantity.units import QuantityError, parse_unit
from drivers.schema.fields import NOT_EMPTY, PositiveSeconds, StrictModel, WholeNumber
from drivers.schema.wording import problem_at, telling

ALL_BITS = 2**32 - 1


def _known_unit(text: str) -> str:
    try:
        parse_unit(text)
    except QuantityError as problem:
        raise telling(str(problem)) from None
    return text


class SampleOptions(StrictModel):
    """The signals of one channel, all in one message."""

    value: SignalName = Field(description="sample of the output")
    tick: SignalName = Field(description="time of the sample by the unit's own clock; it wraps")
    tick_period: PositiveSeconds = Field(description="duration of one count of the tick")
    sequence: SignalName = Field(description="sequence number of the sample; it wraps")
    status: SignalName | None = Field(None, description="status bits of the sample")
    invalid_bits: Annotated[WholeNumber, Field(ge=1, le=ALL_BITS)] = Field(
        ALL_BITS, description="status bits that mark an invalid sample"
    )
    period: PositiveSeconds = Field(description="period of the samples")
    unit: Annotated[str, Field(min_length=1), AfterValidator(_known_unit)] | None = Field(
        None,
        description="what the value is in when it is decoded by factor and offset of the DBC; without it the codes are "
        "taken as they come, and their unit is code",
    )
    stuck_after: Annotated[WholeNumber, Field(ge=2)] | None = Field(
        None, description="number of consecutive equal samples that mean that the unit no longer measures"
    )
    sample: Literal["mean", "instant"] = Field(
        "mean",
        description="kind of samples: mean over the period that ends at the tick, or the output at the tick",
    )

    @property
    def signals(self) -> Mapping[str, str | None]:
        """Signals by their keys in the options."""
        return {key: getattr(self, key) for key in ("value", "tick", "sequence", "status")}

    @property
    def output(self) -> Sampled:
        """Output of the unit on this channel."""
        averaged = self.sample == "mean"
        return Sampled(self.period, self.tick_period, self.unit or CODE, averaged, self.stuck_after)


class SampledPositionOptions(PositionOptions):
    """The signals of a table's encoder, which is latched at the end of each sample of a channel."""

    channel: str = Field(description="channel with whose samples it is latched")


class TelemetryOptions(DbcOptions):
    """Positions of the samples in the frames; names are Message.Signal of the DBC."""

    channels: Annotated[dict[str, SampleOptions], NOT_EMPTY]
    positions: dict[str, SampledPositionOptions] = Field(
        {}, description="encoders that are latched with the samples, by the devices that drive their axes"
    )

    @model_validator(mode="after")
    def _signals_are_in_the_dbc(self) -> Self:
        if not self.dbc.is_file():  # a bench file stored in a run outlives the files it names
            return self
        problems = list(unknown_signals(self.dbc, {
            ("channels", channel, key): name
            for channel, sample in self.channels.items()
            for key, name in sample.signals.items()
        } | encoder_signals(self.positions)))  # fmt: skip
        problems += [
            problem_at(("positions", device, "channel"), f"there is no channel '{encoder.channel}'")
            for device, encoder in self.positions.items()
            if encoder.channel not in self.channels
        ]
        problems = problems or [found for channel in self.channels for found in self._misfits(channel)]
        if problems:
            raise ValidationError.from_exception_data(type(self).__name__, problems)
        return self

    def _misfits(self, channel: str) -> Iterator[InitErrorDetails]:
        """Inconsistencies of a channel."""
        sample, units, bits = self.channels[channel], signals_of(self.dbc), lengths_bits(text_of(self.dbc))
        message = sample.value.partition(".")[0]
        for key, name in sample.signals.items():
            if name is not None and name.partition(".")[0] != message:
                yield problem_at(("channels", channel, key), f"'{name}' is not in {message}, where the value is")
        stated = units[sample.value]
        if sample.unit is not None and stated and not _alike(stated, sample.unit):
            yield problem_at(("channels", channel, "unit"), f"'{sample.value}' is in '{stated}' in {self.dbc.name}")
        if {sample.tick, sample.sequence} <= bits.keys():
            round_s, span_s = 2 ** bits[sample.tick] * sample.tick_period, 2 ** bits[sample.sequence] * sample.period
            if round_s <= span_s / 2:
                problem = (
                    f"'{sample.tick}' wraps around after {round_s:g} s; the sample numbers detect gaps of up to "
                    f"{span_s / 2:g} s: use a longer signal, or a shorter one for the numbers"
                )
                yield problem_at(("channels", channel, "tick"), problem)


def _alike(stated: str, wanted: str) -> bool:
    """Return whether the unit in a DBC is the same in another spelling."""
    try:
        return parse_unit(stated) == parse_unit(wanted)
    except QuantityError:
        return False
