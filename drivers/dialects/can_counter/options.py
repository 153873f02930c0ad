"""Bench file keys of a pulse counter on CAN."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Self

from pydantic import Field, ValidationError, model_validator
from pydantic_core import InitErrorDetails

from drivers.can.dbc_outline import lengths_bits
from drivers.can.options import (
    DbcOptions,
    PositionOptions,
    SignalName,
    encoder_signals,
    text_of,
    unknown_signals,
)
from drivers.schema.fields import NOT_EMPTY, Hertz, PositiveSeconds, StrictModel
from drivers.schema.wording import problem_at


class LatchOptions(StrictModel):
    """The frame with the time at which the counters were latched."""

    tick: SignalName = Field(description="time of the latch")
    tick_period: PositiveSeconds = Field(description="duration of one count of the tick")
    sequence: SignalName = Field(description="sequence number of the latch")
    boot_count: SignalName | None = Field(None, description="counts restarts of the counter")


class ChannelOptions(StrictModel):
    """The signals of one pair of counters."""

    positive: SignalName = Field(description="the counter of positive pulses")
    negative: SignalName = Field(description="the counter of negative pulses")
    sequence: SignalName = Field(description="sequence number of their latch")


class CounterOptions(DbcOptions):
    """Positions of the counters in the frames; names are Message.Signal of the DBC."""

    period: PositiveSeconds = Field(description="period of the latches")
    max_rate: Hertz = Field(description="maximum pulse rate; bounds the gap over which a counter stays unambiguous")
    latch: LatchOptions
    channels: Annotated[dict[str, ChannelOptions], NOT_EMPTY]
    positions: dict[str, PositionOptions] = Field(
        {}, description="encoders that are latched as well, by the devices that drive their axes"
    )

    @model_validator(mode="after")
    def _signals_are_in_the_dbc(self) -> Self:
        if not self.dbc.is_file():  # a bench file stored in a run outlives the files it names
            return self
        named: dict[tuple[str | int, ...], str | None] = {
            ("latch", "tick"): self.latch.tick,
            ("latch", "sequence"): self.latch.sequence,
            ("latch", "boot_count"): self.latch.boot_count,
        }
        for channel, signals in self.channels.items():
            named.update({("channels", channel, key): name for key, name in signals})
        named |= encoder_signals(self.positions)
        problems = list(unknown_signals(self.dbc, named)) or [*self._scattered(), *self._ambiguous()]
        if problems:
            raise ValidationError.from_exception_data(type(self).__name__, problems)
        return self

    def _scattered(self) -> Iterator[InitErrorDetails]:
        """Problems: signals that must share a frame and do not, and counters with different ranges."""
        groups: dict[tuple[str, ...], tuple[str, dict[str, str | None]]] = {
            ("latch",): (self.latch.sequence, {"tick": self.latch.tick, "boot_count": self.latch.boot_count})
        }
        for channel, signals in self.channels.items():
            own = {"positive": signals.positive, "negative": signals.negative}
            groups["channels", channel] = signals.sequence, dict(own)
        for device, encoder in self.positions.items():
            groups["positions", device] = encoder.sequence, {"position": encoder.position}
        for place, (sequence, others) in groups.items():
            message = sequence.partition(".")[0]
            for key, name in others.items():
                if name is not None and name.partition(".")[0] != message:
                    problem = f"'{name}' is not in {message}, where the sequence is"
                    yield problem_at((*place, key), problem)
        bits_of = lengths_bits(text_of(self.dbc))
        for channel, signals in self.channels.items():
            positive, negative = bits_of.get(signals.positive), bits_of.get(signals.negative)
            if None not in (positive, negative) and positive != negative:
                problem = (
                    f"'{signals.negative}' has {negative} bits, '{signals.positive}' {positive}: both must be equal"
                )
                yield problem_at(("channels", channel, "negative"), problem)

    def _ambiguous(self) -> Iterator[InitErrorDetails]:
        """Counters that may wrap between two latches, so that their difference is ambiguous."""
        bits_of, pulses = lengths_bits(text_of(self.dbc)), self.period * self.max_rate
        for channel, signals in self.channels.items():
            for key in ("positive", "negative"):
                name = getattr(signals, key)
                if name in bits_of and pulses >= 2 ** bits_of[name]:
                    problem = (
                        f"'{name}' has {bits_of[name]} bits and wraps around after {2 ** bits_of[name]} pulses; "
                        f"max_rate gives up to {pulses:.6g} in a period: shorten the period, or use a longer signal"
                    )
                    yield problem_at(("channels", channel, key), problem)
