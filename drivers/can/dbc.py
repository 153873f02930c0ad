"""CAN messages described by a DBC: parsed once by cantools, decoded and encoded by numpy for whole blocks of frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache, reduce
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.can.dbc_outline import READINGS, UNITS
from drivers.can.frame_block import EXTENDED, FrameBlock, Kind, Sent
from drivers.can.options import text_of
from drivers.can.sorted_block import SortedBlock

if TYPE_CHECKING:
    from cantools.database.can import Message as CantoolsMessage


class DbcError(ValueError):
    """A DBC that cannot be used, or a name that it does not contain."""


class Signal(NamedTuple):
    """A bit field of a frame: `shift` counts from the least significant bit of the 64-bit word in its byte order."""

    name: str
    shift: int
    length: int
    big_endian: bool
    signed: bool
    scale: float
    offset: float
    unit: str

    def raw(self, words: NDArray[np.uint64]) -> NDArray[np.int64]:
        """Decode the integers in the data of frames as little-endian words, (N,); up to 63 bits, or 64 signed."""
        words = (words.byteswap() if self.big_endian else words) >> np.uint64(self.shift)
        if self.shift + self.length < 64:
            words &= np.uint64((1 << self.length) - 1)
        values = words.view(np.int64)
        if self.signed and self.length < 64:
            unused = np.int64(64 - self.length)
            values = (values << unused) >> unused
        return values

    def raw_of(self, data: bytes) -> int:
        """Decode the integer of one frame's data (8 bytes)."""
        value = int.from_bytes(data, "big" if self.big_endian else "little") >> self.shift & (1 << self.length) - 1
        return value - (1 << self.length) if self.signed and value >> (self.length - 1) else value

    def physical(self, words: NDArray[np.uint64]) -> NDArray[np.float64]:
        """Decode values in `unit` as `raw` does integers."""
        return np.asarray(self.raw(words) * self.scale + self.offset, np.float64)

    def bits(self, values: NDArray[np.int64]) -> NDArray[np.uint64]:
        """Encode integers (N,) into the frames' 64-bit words, little-endian; bits beyond the field are cut."""
        words = values.view(np.uint64) & np.uint64((1 << self.length) - 1)
        if self.shift:
            words <<= np.uint64(self.shift)
        return words.byteswap() if self.big_endian else words


@dataclass(frozen=True, slots=True)
class Message:
    """A CAN message: its id, length and signals."""

    name: str
    id: int
    length: int
    signals: Mapping[str, Signal]

    def signal(self, name: str) -> Signal:
        """Signal of this name; DbcError lists the available ones."""
        if name not in self.signals:
            raise DbcError(f"message {self.name} has no signal '{name}'; it has {', '.join(self.signals)}")
        return self.signals[name]

    def rows(self, block: FrameBlock) -> NDArray[np.intp]:
        """Rows of this message in a block; frames whose length differs from the DBC are ignored."""
        return self.sent_in(block).rows

    def sent_in(self, block: FrameBlock) -> Sent:
        """Frames of this message in a block; those whose length differs from the DBC are ignored."""
        return block.sent(self.id, self.length)


class Field(NamedTuple):
    """A signal and the message that carries it."""

    message: Message
    signal: Signal


class Dbc:
    """The messages of one DBC text."""

    def __init__(self, text: str) -> None:
        from cantools.database.can import Database  # import takes 125 ms: only where frames are decoded

        database = Database()
        try:
            database.add_dbc_string(text)
        except Exception as problem:  # cantools raises errors of many kinds from its parser
            raise DbcError(f"not a usable DBC: {problem}") from problem
        messages = [message for message in database.messages if message.length <= 8]  # identifiers of classical CAN
        self.messages = {message.name: _message(message) for message in messages}

    def message(self, name: str) -> Message:
        """Message of this name; DbcError lists the available ones."""
        if name not in self.messages:
            raise DbcError(f"the DBC has no message '{name}'; it has {', '.join(self.messages)}")
        return self.messages[name]

    def field(self, dotted: str) -> Field:
        """Look up the signal `Message.Signal`; DbcError if it is not in the DBC."""
        message, _, signal = dotted.partition(".")
        found = self.message(message)
        return Field(found, found.signal(signal))

    @property
    def readings(self) -> dict[str, Field]:
        """Signals with the unit of a reading, by `Message.Signal`."""
        return {
            f"{message.name}.{signal.name}": Field(message, signal)
            for message in self.messages.values()
            for signal in message.signals.values()
            if signal.unit in READINGS
        }


def dbc_in(path: Path) -> Dbc:
    """Parse a DBC file; raises UnfitFileError if it cannot be read, DbcError if it is not a valid DBC."""
    return dbc_of(text_of(path))


@lru_cache(maxsize=8)  # cache for the few nodes of a bench, needed for each label of a run
def dbc_of(text: str) -> Dbc:
    """Parse the text of a DBC, once; raises DbcError."""
    return Dbc(text)


def _message(message: CantoolsMessage) -> Message:
    """Convert a cantools message; multiplexed and floating-point signals are left out: no counter sends them."""
    signals = {}
    for signal in message.signals:
        if signal.multiplexer_ids or signal.is_multiplexer or signal.is_float:
            continue
        big_endian = signal.byte_order == "big_endian"
        shift = signal.start
        if big_endian:  # for big-endian signals the DBC's start is the most significant bit, numbered byte by byte
            shift = 64 - (8 * (signal.start // 8) + 7 - signal.start % 8) - signal.length
        signals[signal.name] = Signal(
            signal.name, shift, signal.length, big_endian, signal.is_signed, float(signal.scale), float(signal.offset),
            UNITS.get(signal.unit or "", signal.unit or ""),
        )  # fmt: skip
    frame_id = message.frame_id | (EXTENDED if message.is_extended_frame else 0)
    return Message(message.name, frame_id, message.length, signals)


def readings_of(
    fields: Mapping[str, Field], block: FrameBlock
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Decode fields in a block: arrival times and physical values by field name, without fields that did not arrive."""
    found, messages = {}, {field.message.id: field.message for field in fields.values()}
    frames = {of_message: message.sent_in(block) for of_message, message in messages.items()}
    for name, field in fields.items():
        rows, words = frames[field.message.id]
        if len(rows):
            found[name] = (block.at_s[rows], field.signal.physical(words))
    return found


def encode_frames(
    dbc: Dbc, at_s: NDArray[np.float64], values: Mapping[str, Mapping[str, NDArray[np.int64]]]
) -> FrameBlock:
    """Encode frames: for each instant of `at_s` (N,) one of each message, in order of id.

    `values` gives (N,) integers by message and signal name; signals not named are 0.
    """
    messages = sorted((dbc.message(name) for name in values), key=lambda message: message.id)
    sent: dict[Kind, Sent] = {}
    for place, message in enumerate(messages):
        fields = [message.signal(name).bits(integers) for name, integers in values[message.name].items()]
        words = reduce(np.bitwise_or, fields) if fields else np.zeros(len(at_s), np.uint64)
        rows = np.arange(place, len(at_s) * len(messages), len(messages))
        sent[message.id, message.length] = Sent(rows, words)
    return SortedBlock(at_s.repeat(len(messages)), sent)
