"""Frames of counters of many kinds: their DBC, what a bench file says of them, and their bytes packed by hand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

LATCH_ID, AXIS_ID = 0x100, 0x200
AXES = "xyz"
Fields = tuple[tuple[str, int], ...]
"""Names and lengths in bits, in the order of the wire."""

_FOLDER = TemporaryDirectory(prefix="can_faults_")


@dataclass(frozen=True)
class Layout:
    """Layout of the frames of a counter; lengths in bits."""

    big_endian: bool
    axes: int
    tick_bits: int
    number_bits: int
    counter_bits: int
    axis_number_bits: int
    has_boots: bool

    @property
    def latch(self) -> Fields:
        boots: Fields = (("Boots", 8),) if self.has_boots else ()
        return (("Tick", self.tick_bits), ("Number", self.number_bits), *boots, ("Value", 8))

    @property
    def axis(self) -> Fields:
        return (("Positive", self.counter_bits), ("Negative", self.counter_bits), ("Number", self.axis_number_bits))

    def packed(self, fields: Fields, values: Mapping[str, int]) -> bytes:
        """The bytes of a frame; what goes beyond a field is cut."""
        word = place = 0
        for name, bits in fields:
            value = values[name] & ((1 << bits) - 1)
            word |= value << (64 - place - bits if self.big_endian else place)
            place += bits
        return word.to_bytes(8, "big" if self.big_endian else "little")[: self.length(fields)]

    def length(self, fields: Fields) -> int:
        """Length of a frame in bytes."""
        return -(-sum(bits for _, bits in fields) // 8)

    def dbc(self) -> Path:
        """A DBC file of it."""
        return _dbc_file(self)

    def names(self) -> dict[str, Any]:
        """Its signals as a bench file names them."""
        latch = {"tick": "Latch.Tick", "sequence": "Latch.Number", "boot_count": "Latch.Boots"}
        if not self.has_boots:
            del latch["boot_count"]
        keys = {"positive": "Positive", "negative": "Negative", "sequence": "Number"}
        channels = {
            name: {key: f"Axis{name.upper()}.{signal}" for key, signal in keys.items()} for name in AXES[: self.axes]
        }
        return {"latch": latch, "channels": channels}


@cache
def _dbc_file(layout: Layout) -> Path:
    lines = ['VERSION ""', "", "NS_ :", "", "BS_:", "", "BU_: A", ""]
    messages = [(LATCH_ID, "Latch", layout.latch)]
    messages += [(AXIS_ID + row, f"Axis{name.upper()}", layout.axis) for row, name in enumerate(AXES[: layout.axes])]
    for frame_id, name, fields in messages:
        lines.append(f"BO_ {frame_id} {name}: {layout.length(fields)} A")
        place = 0
        for signal, bits in fields:
            start = 8 * (place // 8) + 7 - place % 8 if layout.big_endian else place
            lines.append(f' SG_ {signal} : {start}|{bits}@{"0" if layout.big_endian else "1"}+ (1,0) [0|0] "" A')
            place += bits
        lines.append("")
    path = Path(_FOLDER.name) / f"{abs(hash(layout)):x}.dbc"
    path.write_text("\n".join(lines), "utf-8")
    return path
