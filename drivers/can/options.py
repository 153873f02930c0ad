"""Bench file keys of devices that send CAN frames unsolicited, described by a DBC."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated

from pydantic import Field
from pydantic_core import InitErrorDetails

from drivers.can.dbc_outline import READINGS, frames_bits, lengths_bits, outline
from drivers.can.sent_frames import BusLoad
from drivers.schema.bounded import read_bounded
from drivers.schema.fields import FileBeside, InUnit, Ratio, Seconds, StrictModel, TextLike
from drivers.schema.suggest import did_you_mean
from drivers.schema.wording import problem_at

FRAME_SCHEMES = frozenset({"slcan", "can", "socketcand", "log"})
DBC_LIMIT_BYTES = 2**20
IDLE_BLOCK_S = 10.0  # interval at which frames are collected outside an acquisition

SignalName = Annotated[str, TextLike(r"\w+\.\w+", "Message.Signal of the DBC")]


class DbcOptions(StrictModel):
    """Options of a device whose frames a DBC describes."""

    dbc: Annotated[Path, FileBeside(DBC_LIMIT_BYTES)] = Field(description="DBC file of the frames")


class PositionOptions(StrictModel):
    """Signals of a table's encoder that is latched with the other data of the node; both have one clock."""

    position: SignalName = Field(description="counts of the encoder, which wrap")
    sequence: SignalName = Field(description="sequence number of their latch or sample")
    resolution: Annotated[float, InUnit("arcsec", above=0)] = Field(description="one count")


class ClockUncertainty(StrictModel):
    """Expanded uncertainty of a node's clock, from its certificate."""

    time_base: Annotated[Ratio, InUnit("", at_least=0)] = Field(
        0.0, description="relative uncertainty of its clock, such as 1 ppm"
    )
    encoder_skew: Seconds = Field(
        0.0,
        description="uncertainty of the delay of an encoder latch after that of the pulses, or the end of the sample",
    )


def encoder_signals(positions: Mapping[str, PositionOptions]) -> dict[tuple[str | int, ...], str | None]:
    """Encoder signals, by their place in the options."""
    return {
        ("positions", device, key): getattr(encoder, key)
        for device, encoder in positions.items()
        for key in ("position", "sequence")
    }


def bus_load(dbc: Path, periods_s: Mapping[str, float], positions: Mapping[str, PositionOptions]) -> BusLoad:
    """Bus load of the frames with these signals, each sent once in its period, and the bits of positions."""
    text = text_of(dbc)
    bits, lengths = frames_bits(text), lengths_bits(text)
    of_messages = {signal.partition(".")[0]: period_s for signal, period_s in periods_s.items()}
    bits_per_s = math.fsum(bits.get(message, 0) / period_s for message, period_s in of_messages.items())
    known = {device: encoder.position for device, encoder in positions.items() if encoder.position in lengths}
    return BusLoad(bits_per_s, {device: lengths[position] for device, position in known.items()})


def text_of(dbc: Path) -> str:
    """Read the text of a DBC file in any encoding; raises UnfitFileError."""
    return read_bounded(dbc, DBC_LIMIT_BYTES).decode("utf-8", errors="replace")


def signals_of(dbc: Path) -> Mapping[str, str]:
    """The signals of a DBC file: `Message.Signal` → unit."""
    return outline(text_of(dbc))


def readings(options: DbcOptions) -> Mapping[str, str]:
    """Every signal of the DBC in °C or in Hz, such as the output of a temperature circuit, is a reading."""
    return {name: unit for name, unit in signals_of(options.dbc).items() if unit in READINGS}


def unknown_signals(dbc: Path, named: Mapping[tuple[str | int, ...], str | None]) -> Iterator[InitErrorDetails]:
    """Signals in the options that the DBC does not contain, by place."""
    known = signals_of(dbc)
    for place, name in named.items():
        if name is not None and name not in known:
            yield problem_at(place, f"{dbc.name} has no signal '{name}'{did_you_mean(name, known)}")
