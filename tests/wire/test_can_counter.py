"""Counter frames typed by hand from the layout of the DBC, read and written.

Latch 0x100: Tick u32 µs, Sequence u16, Status u8, BootCount u8. AxisX/Y/Z 0x101 to 0x103: Positive u24, Negative u24,
Sequence u16. Temperatures 0x110: Unit and Converter i16 in 0.01 °C, Sequence u16. Little-endian throughout.
"""

import os
import subprocess
import sys

import numpy as np
import pytest

from drivers.can.dbc import Dbc, DbcError, encode_frames
from drivers.can.frame_block import FrameBlock
from drivers.dialects.can_counter.wire import (
    Counts,
    decode_counts,
    decode_positions,
    latches,
    newest_counts,
    temperatures,
)
from drivers.transport import slcan
from drivers.transport.alike import Arrivals
from tests.support.frames import frames
from tests.support.laboratory import CHANNELS, DBC, LATCH, ROOT, counter_form, format_in

FORM = counter_form()

# 1.0 s and 1.1 s on the device's clock (0x000F4240, 0x0010C8E0), latches 42 and 43, third power-on
TWO_LATCHES = (
    "100 8 40 42 0F 00 2A 00 00 03",
    "101 8 18 FF FF 07 00 00 2A 00",  # + 16,776,984, - 7
    "102 8 00 00 00 56 34 12 2A 00",  # + 0, - 1,193,046
    "103 8 01 00 00 02 00 00 2A 00",
    "110 6 54 F0 C4 09 2A 00",  # -40.12 °C, 25.00 °C
    "100 8 E0 C8 10 00 2B 00 00 03",
    "101 8 82 03 00 07 00 00 2B 00",  # + 898: round by 2**24, 1130 pulses more
    "102 8 00 00 00 57 34 12 2B 00",
    "103 8 01 00 00 02 00 00 2B 00",
    "110 6 34 21 C4 09 2B 00",  # 85.00 °C
)


def summary(counts: Counts) -> dict[str, object]:
    return {
        "sequence": counts.sequence.tolist(), "positive": counts.positive.tolist(), "lost": counts.lost,
        "dropped": counts.dropped, "restarts": counts.restarts,
    }  # fmt: skip


def latch(number: int, tick: int = 0, boot: int = 3) -> str:
    return f"100 8 {tick.to_bytes(4, 'little').hex()} {number.to_bytes(2, 'little').hex()} 00 {boot:02X}"


def axis(number: int, positive: int) -> str:
    return f"101 8 {positive.to_bytes(3, 'little').hex()} 000000 {number.to_bytes(2, 'little').hex()}"


def pair(number: int, boot: int = 3) -> tuple[str, str]:
    """A latch and its axis, whose count tells the latch again."""
    return latch(number, boot=boot), axis(number, number)


# Reading


def test_latches_and_counts_are_read() -> None:
    counts = decode_counts(FORM, "x", frames(*TWO_LATCHES))
    assert counts.sequence.tolist() == [42, 43]
    assert counts.tick.tolist() == [1_000_000, 1_100_000]
    assert counts.positive.tolist() == [16_776_984, 898]
    assert counts.negative.tolist() == [7, 7]
    assert counts.host_s.tolist() == [0.0, 0.05]
    assert (counts.tick_bits, counts.counter_bits) == (32, 24)
    assert (counts.lost, counts.dropped, counts.restarts) == (0, 0, 0)


def test_the_other_channels_are_read() -> None:
    y, z = (decode_counts(FORM, name, frames(*TWO_LATCHES)) for name in "yz")
    assert (y.positive.tolist(), y.negative.tolist()) == ([0, 0], [0x123456, 0x123457])
    assert (z.positive.tolist(), z.negative.tolist()) == ([1, 1], [2, 2])


def test_temperatures_are_read() -> None:
    found = temperatures(FORM, frames(*TWO_LATCHES, "110 6 00 80 FF 7F 2C 00"))
    assert list(found) == ["Temperatures.Unit", "Temperatures.Converter"]
    at_s, unit_c = found["Temperatures.Unit"]
    assert at_s.tolist() == [0.04, 0.09, 0.1]
    assert unit_c.tolist() == pytest.approx([-40.12, 85.0, -327.68])
    assert found["Temperatures.Converter"][1].tolist() == pytest.approx([25.0, 25.0, 327.67])
    assert temperatures(FORM, frames(TWO_LATCHES[0])) == {}


def test_latches_are_read_alone() -> None:
    numbers, at_s = latches(FORM, frames(*TWO_LATCHES))
    assert (numbers.tolist(), at_s.tolist()) == ([42, 43], [0.0, 0.05])


def test_an_empty_block_holds_nothing() -> None:
    counts = decode_counts(FORM, "x", FrameBlock.empty())
    assert summary(counts) == {"sequence": [], "positive": [], "lost": 0, "dropped": 0, "restarts": 0}
    assert len(latches(FORM, FrameBlock.empty())[0]) == 0
    assert temperatures(FORM, FrameBlock.empty()) == {}


# What is not as it should be


def test_the_sequence_goes_round() -> None:
    counts = decode_counts(FORM, "x", frames(*pair(0xFFFE), *pair(0xFFFF), *pair(0), *pair(1)))
    assert summary(counts) == {
        "sequence": [65534, 65535, 65536, 65537], "positive": [65534, 65535, 0, 1], "lost": 0, "dropped": 0,
        "restarts": 0,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("lines", "sequence", "lost", "dropped"),
    [
        ((*pair(1), *pair(4), *pair(5)), [1, 4, 5], 2, 0),  # whole latches lost
        ((*pair(1), latch(2), *pair(3)), [1, 3], 1, 0),  # an axis lost
        ((*pair(1), axis(2, 2), *pair(3)), [1, 3], 1, 0),  # a latch lost
        ((axis(9, 9), *pair(10), *pair(11)), [10, 11], 0, 0),  # began in the middle of a latch
        ((*pair(10), latch(11)), [10], 0, 0),  # ended in the middle of one
        ((*pair(10), latch(11), latch(12)), [10], 1, 0),  # and one before that came without its axis
        ((*pair(1), *pair(1), *pair(2), *pair(2)), [1, 2], 0, 4),  # everything twice
        ((*pair(1), *pair(3), *pair(2), *pair(4)), [1, 3, 4], 1, 2),  # one late: a gap
        ((latch(1), latch(2), axis(1, 1), axis(2, 2)), [1, 2], 0, 0),  # axes behind by a latch
        ((latch(1), axis(2, 2), axis(1, 1), latch(2)), [2], 1, 1),  # axes out of order
        ((axis(1, 1), axis(2, 2)), [], 0, 0),  # no latch at all
        ((latch(1), latch(2)), [], 1, 0),  # no axis at all
        ((*pair(0xFFFF), *pair(2)), [65535, 65538], 2, 0),  # a gap over the end of the range
    ],
)
def test_lost_frames_are_counted_and_late_ones_dropped(
    lines: tuple[str, ...], sequence: list[int], lost: int, dropped: int
) -> None:
    found = summary(decode_counts(FORM, "x", frames(*lines)))
    assert found == {
        "sequence": sequence, "positive": [number % 65536 for number in sequence], "lost": lost, "dropped": dropped,
        "restarts": 0,
    }  # fmt: skip


def test_foreign_frames_and_frames_of_another_length_are_passed_over() -> None:
    strange = ("200 8 40 42 0F 00 2A 00 00 03", "101 7 18 FF FF 07 00 00 2A", "100 0", "7FF 1 00")
    plain, mixed = frames(*TWO_LATCHES), frames(*strange, *TWO_LATCHES[:3], *strange, *TWO_LATCHES[3:], *strange)
    for name in "xyz":
        first, second = decode_counts(FORM, name, plain), decode_counts(FORM, name, mixed)
        assert summary(first) == summary(second)
        assert first.tick.tolist() == second.tick.tolist()


def test_an_extended_identifier_is_another_frame() -> None:
    block, _, junk = slcan.parse(b"T00000100840420F002A000003\r", Arrivals.at_once(0.0))
    assert (len(block), junk) == (1, 0)
    assert len(latches(FORM, block)[0]) == 0


# A counter that begins anew


@pytest.mark.parametrize("last", [3, 30_000, 40_000, 65_535])
def test_a_change_of_the_boot_counter_is_a_restart_wherever_the_sequence_stood(last: int) -> None:
    """From there to 1 the sequence may look like a gap, like frames that are late, or like the next latch."""
    counts = decode_counts(FORM, "x", frames(*pair(last), *pair(1, boot=4), *pair(2, boot=4), *pair(3, boot=4)))
    assert counts.restarts == 1


def test_a_counter_without_a_boot_counter_has_no_restarts() -> None:
    form = counter_form(boot_count=False)
    assert form.boot_count is None
    assert decode_counts(form, "x", frames(*pair(1), *pair(2, boot=4))).restarts == 0


@pytest.mark.parametrize(
    ("lines", "restarts"),
    [
        ((latch(900, 900), latch(901, 901), latch(0, 77), latch(1, 78)), 1),  # at another time of its clock
        ((latch(900, 900), latch(901, 901), latch(0, 0), latch(1, 1)), 1),  # as at its last power-on, much earlier
        ((latch(900, 900), latch(902, 902), latch(901, 901), latch(903, 903)), 0),  # late
        ((latch(900, 900), latch(901, 901), latch(901, 901), latch(902, 902)), 0),  # twice
        ((latch(900, 900), latch(901, 901), latch(836, 836), latch(902, 902)), 1),  # later than any frame comes
    ],
)
def test_a_restart_that_no_boot_counter_tells_is_one_where_the_sequence_goes_back(
    lines: tuple[str, ...], restarts: int
) -> None:
    form = counter_form(boot_count=False)
    assert decode_counts(form, "x", frames(*lines)).restarts == restarts


def test_gaps_are_told_by_their_first_and_last_latch() -> None:
    lines = (*pair(0xFFFD), latch(0xFFFE), *pair(1), axis(2, 2), *pair(3), latch(4), latch(5))
    counts = decode_counts(FORM, "x", frames(*lines))
    assert counts.first == 0xFFFD
    assert counts.gaps.tolist() == [[0xFFFE, 0x10000], [0x10002, 0x10002], [0x10004, 0x10004]]
    assert counts.lost == 5
    assert decode_counts(FORM, "x", FrameBlock.empty()).gaps.shape == (0, 2)


# Another laboratory's counter: Motorola, its axis numbered with 8 bits and its latch with 16

OTHER = Dbc("""VERSION ""
NS_ :
BS_:
BU_: A
BO_ 2147484416 Mark: 6 A
 SG_ T : 7|32@0+ (1,0) [0|0] "" A
 SG_ N : 39|16@0+ (1,0) [0|0] "" A
BO_ 769 Pulses: 5 A
 SG_ P : 7|16@0+ (1,0) [0|0] "" A
 SG_ M : 23|16@0+ (1,0) [0|0] "" A
 SG_ N : 39|8@0+ (1,0) [0|0] "" A
""")
OTHER_FORM = format_in(
    OTHER, {"tick": "Mark.T", "sequence": "Mark.N", "tick_period": "10 µs"},
    {"x": {"positive": "Pulses.P", "negative": "Pulses.M", "sequence": "Pulses.N"}},
)  # fmt: skip


def other(*lines: str) -> FrameBlock:
    text = "".join(line.replace(" ", "") + "\r" for line in lines)
    block, _, junk = slcan.parse(text.encode(), Arrivals.at_once(0.0))
    assert junk == 0
    return block


def test_a_motorola_counter_with_an_extended_identifier_is_read() -> None:
    counts = decode_counts(
        OTHER_FORM, "x", other(
            "T 00000300 6 00 01 86 A0 01 FF", "t 301 5 12 34 00 07 FF",
            "T 00000300 6 00 03 0D 40 02 00", "t 301 5 12 38 00 07 00",
        ),
    )  # fmt: skip
    assert counts.sequence.tolist() == [511, 512]
    assert counts.tick.tolist() == [100_000, 200_000]
    assert counts.positive.tolist() == [0x1234, 0x1238]
    assert counts.negative.tolist() == [7, 7]
    assert (counts.tick_bits, counts.counter_bits) == (32, 16)


def test_a_narrow_number_finds_its_latch_after_any_gap() -> None:
    """The axis is silent for 300 latches, more than its 8 bits tell."""
    lines = []
    for number in range(400):
        lines.append(f"T 00000300 6 00000000 {number:04X}")
        if not 20 <= number < 320:
            lines.append(f"t 301 5 {number:04X} 0000 {number % 256:02X}")
    counts = decode_counts(OTHER_FORM, "x", other(*lines))
    assert counts.sequence.tolist() == counts.positive.tolist() == [*range(20), *range(320, 400)]
    assert (counts.lost, counts.dropped) == (300, 0)


# An encoder latched with the counters: 0x108, Position u32 in counts of 0.36 arcsec, Sequence u16

TABLE_FORM = format_in(
    Dbc((ROOT / "config" / "response.dbc").read_text("utf-8")), LATCH,
    {"gyro": {key: f"Pulses.{key.capitalize()}" for key in ("positive", "negative", "sequence")}},
    {"table": {"position": "Encoder.Position", "sequence": "Encoder.Sequence"}},
)  # fmt: skip


def test_an_encoder_is_read_with_its_latches() -> None:
    block = frames(
        "100 8 40 42 0F 00 FF FF 00 03", "101 8 01 00 00 02 00 00 FF FF", "108 6 FE FF FF FF FF FF",  # - 2 counts
        "100 8 28 46 0F 00 00 00 00 03", "101 8 03 00 00 02 00 00 00 00", "108 6 80 EE 36 00 00 00",  # a whole turn
        "100 8 10 4A 0F 00 01 00 00 03", "101 8 05 00 00 02 00 00 01 00",  # its encoder did not come
        "100 8 F8 4D 0F 00 02 00 00 03", "108 6 00 DD 6D 00 02 00",  # its pulses did not come
    )  # fmt: skip
    read, counts = decode_positions(TABLE_FORM, "table", block), decode_counts(TABLE_FORM, "gyro", block)
    assert read.sequence.tolist() == [65535, 65536, 65538]
    assert read.tick.tolist() == [1_000_000, 1_001_000, 1_003_000]
    assert read.position.tolist() == [2**32 - 2, 3_600_000, 7_200_000]
    assert (read.tick_bits, read.position_bits, read.lost, read.restarts) == (32, 32, 1, 0)
    assert counts.sequence.tolist() == [65535, 65536, 65537]
    assert counts.positive.tolist() == [1, 3, 5]


# Writing


def test_frames_are_written_as_they_are_read() -> None:
    """One of each message at each instant, in order of identifier."""
    at_s = np.array([0.0, 0.1])
    written = encode_frames(DBC, at_s, {
        "AxisX": {"Positive": np.array([16_776_984, 2**24 + 898]), "Negative": np.array([7, 7]),
                  "Sequence": np.array([42, 65536 + 43])},
        "Latch": {"Tick": np.array([1_000_000, 2**32 + 1_100_000]), "Sequence": np.array([42, 43]),
                  "BootCount": np.array([3, 3])},
        "Temperatures": {"Unit": np.array([-4012, 8500]), "Converter": np.array([2500, 2500]),
                         "Sequence": np.array([42, 43])},
    })  # fmt: skip
    wanted = frames(*(TWO_LATCHES[row] for row in (0, 1, 4, 5, 6, 9)))
    assert written.ids.tolist() == wanted.ids.tolist()
    assert written.dlc.tolist() == wanted.dlc.tolist()
    assert written.data.tolist() == wanted.data.tolist()
    assert written.at_s.tolist() == [0.0, 0.0, 0.0, 0.1, 0.1, 0.1]


def test_motorola_frames_are_written() -> None:
    written = encode_frames(OTHER, np.zeros(1), {"Mark": {"T": np.array([100_000]), "N": np.array([511])}})
    assert written.data[0].tobytes().hex() == "000186a001ff0000"


# Binding


@pytest.mark.parametrize(
    ("latch_names", "channels", "problem"),
    [
        ({**LATCH, "tick": "Latch.Time"}, CHANNELS, "message Latch has no signal 'Time'"),
        ({**LATCH, "boot_count": "Boot.Count"}, CHANNELS, "no message 'Boot'"),
        (LATCH, {"x": {**CHANNELS["x"], "negative": "AxisX.Minus"}}, "message AxisX has no signal 'Minus'"),
    ],
)
def test_names_that_the_dbc_does_not_have_are_told(latch_names: dict, channels: dict, problem: str) -> None:
    with pytest.raises(DbcError, match=problem):
        format_in(DBC, latch_names, channels)


def test_the_wire_format_loads_no_transport() -> None:
    code = (
        "import sys, drivers.dialects.can_counter.wire; "
        "print([name for name in ('asyncio', 'socket', 'serial', 'can', 'pymodbus', 'cantools', 'drivers.transport') "
        "if name in sys.modules])"
    )
    unmeasured = {name: value for name, value in os.environ.items() if not name.startswith("COVERAGE")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=unmeasured)
    assert done.stdout.strip() == "[]"


def test_the_newest_counts_are_those_of_the_last_frame_of_each_channel() -> None:
    found = newest_counts(FORM, frames(*TWO_LATCHES))
    assert {name: counts for name, (_, counts) in found.items()} == {
        "x": (0x382, 7), "y": (0, 0x123457), "z": (1, 2),
    }  # fmt: skip
    assert found["x"][0] == frames(*TWO_LATCHES).at_s[6]
    assert newest_counts(FORM, frames(TWO_LATCHES[1])).keys() == {"x"}
    assert newest_counts(FORM, FrameBlock.empty()) == {}


def test_a_channel_that_is_silent_is_found_where_its_last_frame_is() -> None:
    many = frames(TWO_LATCHES[3], *TWO_LATCHES[1:3] * 2000)
    assert newest_counts(FORM, many)["z"][1] == (1, 2)
