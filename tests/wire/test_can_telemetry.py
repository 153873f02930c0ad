"""Telemetry frames typed by hand from the layout of the DBC, read.

AccX 0x200, AccY 0x201: Code i24, Tick u24 in 10 µs, Sequence u8, Status u8; little-endian. Housekeeping 0x210: Sensor
and Board i16 in 0.01 °C. A second layout is big-endian, with two channels in one message, one of them scaled.
"""

import numpy as np
import pytest

from bench.config.bench import load_bench
from drivers.can.dbc import Dbc, DbcError, encode_frames, readings_of
from drivers.can.encoder_frames import position_formats
from drivers.can.frame_block import FrameBlock
from drivers.can.options import PositionOptions
from drivers.dialects.can_telemetry.decoder import TelemetryDecoder
from drivers.dialects.can_telemetry.options import SampleOptions
from drivers.dialects.can_telemetry.wire import Samples, arrivals, decode_positions, decode_samples, sample_formats
from tests.support.frames import frames
from tests.support.laboratory import ROOT
from tests.support.telemetry import DBC, FORMS

X, Y = FORMS["x"], FORMS["y"]

FOUR = (
    "200 8 80 1A 06 E8 03 00 01 00",  # + 400 000 at 1000 ticks, sample 1
    "201 8 FF FF 7F 88 13 00 01 80",  # y: the largest code, warming up
    "210 4 C4 09 54 F0",  # 25.00 °C, -40.12 °C
    "200 8 80 E5 F9 B8 0B 00 02 80",  # - 400 000 at 3000 ticks, sample 2, warming up
)


def sample(number: int, tick: int | None = None, code: int = 7, status: int = 0) -> str:
    """A frame of x; the tick is 2000 for every number unless it is given."""
    tick = 2000 * number if tick is None else tick
    data = (code % 2**24).to_bytes(3, "little") + (tick % 2**24).to_bytes(3, "little")
    return f"200 8 {data.hex()} {number % 256:02X} {status:02X}"


def signals(**named: object) -> SampleOptions:
    return SampleOptions.model_validate({"period": "20 ms", "tick_period": "10 µs", **named})


def summary(samples: Samples) -> dict[str, object]:
    return {
        "sequence": samples.sequence.tolist(), "lost": samples.lost, "dropped": samples.dropped,
        "invalid": samples.invalid,
    }  # fmt: skip


# Reading


def test_codes_are_signed_and_have_the_time_of_the_unit() -> None:
    found = decode_samples(X, frames(*FOUR))
    assert found.values.tolist() == [400_000.0, -400_000.0]
    assert found.tick.tolist() == [1000, 3000]
    assert found.host_s.tolist() == [0.0, 0.03]
    assert found.tick_bits == 24
    assert summary(found) == {"sequence": [1, 2], "lost": 0, "dropped": 0, "invalid": 0}
    assert X.scale == (1.0, 0.0)


def test_each_channel_has_its_own_frames() -> None:
    found = decode_samples(Y, frames(*FOUR))
    assert (found.values.tolist(), found.tick.tolist()) == ([8_388_607.0], [5000])


def test_temperatures_are_read_beside_them() -> None:
    found = readings_of(DBC.readings, frames(*FOUR))
    assert found["Housekeeping.Sensor"][1].tolist() == pytest.approx([25.0])
    assert found["Housekeeping.Board"][1].tolist() == pytest.approx([-40.12])
    assert found["Housekeeping.Board"][0].tolist() == [0.02]


def test_what_arrived_is_told_raw() -> None:
    numbers, codes, at_s = arrivals(X, frames(*FOUR, sample(1)))
    assert (numbers.tolist(), codes.tolist(), at_s.tolist()) == ([1, 2, 1], [400_000, -400_000, 7], [0.0, 0.03, 0.04])


def test_an_empty_block_holds_nothing() -> None:
    found = decode_samples(X, FrameBlock.empty())
    assert summary(found) == {"sequence": [], "lost": 0, "dropped": 0, "invalid": 0}
    assert len(found.values) == len(found.tick) == len(found.host_s) == 0


# What is not as it should be


@pytest.mark.parametrize(
    ("lines", "sequence", "lost", "dropped"),
    [
        ((sample(1), sample(4), sample(5)), [1, 4, 5], 2, 0),  # lost
        ((sample(1), sample(1), sample(2), sample(2)), [1, 2], 0, 2),  # each twice
        ((sample(1), sample(3), sample(2), sample(4)), [1, 3, 4], 1, 1),  # one late: a gap
        ((sample(254), sample(255), sample(256), sample(257)), [254, 255, 256, 257], 0, 0),  # the number goes round
        ((sample(254), sample(258)), [254, 258], 3, 0),  # a gap over the end of its range
        ((sample(1), sample(2), sample(1000), sample(1001)), [1, 2, 1000, 1001], 997, 0),  # the clock tells how long
        ((sample(1), sample(2), sample(200), sample(199), sample(201)), [1, 2, 200, 201], 197, 1),  # more than half
        ((sample(100), sample(0, tick=0), sample(1, tick=2000)), [100], 0, 2),  # a reset: smaller numbers come late
        ((sample(250), sample(0, tick=0), sample(1, tick=2000)), [250, 256, 257], 5, 0),  # one that looks like a gap
        ((sample(5), "200 7 07 00 00 70 17 00 06", sample(7)), [5, 7], 1, 0),  # a frame of another length
    ],
)
def test_lost_samples_are_counted_and_late_ones_dropped(
    lines: tuple[str, ...], sequence: list[int], lost: int, dropped: int
) -> None:
    found = summary(decode_samples(X, frames(*lines)))
    assert found == {"sequence": sequence, "lost": lost, "dropped": dropped, "invalid": 0}


def test_the_clock_is_raw_and_wraps() -> None:
    found = decode_samples(X, frames(sample(1, tick=2**24 - 1000), sample(2, tick=2**24 + 1000)))
    assert found.tick.tolist() == [16_776_216, 1000]


def test_what_the_unit_marks_is_left_out_and_counted() -> None:
    over, test, warm = sample(2, status=0x01), sample(3, status=0x82), sample(4, status=0x80)
    found = decode_samples(X, frames(sample(1), over, test, warm))
    assert summary(found) == {"sequence": [1, 4], "lost": 0, "dropped": 0, "invalid": 2}


# Another layout

OTHER = Dbc("""VERSION "1"
BU_: UNIT BENCH
BO_ 768 Pair: 8 UNIT
 SG_ First : 7|16@0- (0.001,0.5) [0|0] "g" BENCH
 SG_ Second : 23|16@0- (0.001,0.5) [0|0] "g" BENCH
 SG_ Tick : 39|16@0+ (1,0) [0|0] "" BENCH
 SG_ Number : 55|8@0+ (1,0) [0|0] "" BENCH
 SG_ Flags : 63|8@0+ (1,0) [0|0] "" BENCH
BO_ 769 Apart: 2 UNIT
 SG_ Number : 7|8@0+ (1,0) [0|0] "" BENCH
""")
PAIR = {"tick": "Pair.Tick", "sequence": "Pair.Number", "status": None, "invalid_bits": 1}
FIRST, SECOND = {"value": "Pair.First", "unit": "g", **PAIR}, {"value": "Pair.Second", "unit": None, **PAIR}
LINE = "300 8 FF 38 03 E8 12 34 2A 01"  # - 200, 1000, tick 0x1234, sample 42; the status is not asked


def test_a_value_is_decoded_by_factor_and_offset_of_the_dbc() -> None:
    forms = sample_formats(OTHER, {"first": signals(**FIRST), "second": signals(**SECOND)})
    first, second = (decode_samples(forms[name], frames(LINE)) for name in ("first", "second"))
    assert first.values.tolist() == pytest.approx([0.3])
    assert second.values.tolist() == [1000.0], "without a unit it is the code as it came"
    assert (forms["first"].scale.factor, forms["second"].scale) == (0.001, (1.0, 0.0))
    assert [found.tick.tolist() for found in (first, second)] == [[0x1234]] * 2
    assert [found.sequence.tolist() for found in (first, second)] == [[42]] * 2


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"value": "Pair.Third"}, "message Pair has no signal 'Third'"),
        ({"tick": "Clock.Tick"}, "no message 'Clock'"),
        ({"sequence": "Apart.Number"}, "channel a is in several messages: Apart, Pair"),
    ],
)
def test_what_does_not_go_together_is_told(change: dict, problem: str) -> None:
    with pytest.raises(DbcError, match=problem):
        sample_formats(OTHER, {"a": signals(**(FIRST | change))})


def test_frames_are_written_as_they_are_read() -> None:
    values = {"AccX": {"Code": np.array([-400_000]), "Tick": np.array([3000]), "Sequence": np.array([258]),
                       "Status": np.array([128])}}  # fmt: skip
    written = encode_frames(DBC, np.zeros(1), values)
    assert written.data.tolist() == frames(FOUR[3]).data.tolist()


# The encoder of a table, latched at the end of each sample

ON_A_TABLE = Dbc((ROOT / "config/table_telemetry.dbc").read_text("utf-8"))
OUTPUT = sample_formats(ON_A_TABLE, {"x": signals(
    value="Output.Code", tick="Output.Tick", sequence="Output.Sequence", status="Output.Status", invalid_bits=3,
)})["x"]  # fmt: skip
ENCODER = position_formats(ON_A_TABLE, {"table": PositionOptions.model_validate({
    "position": "Encoder.Position", "sequence": "Encoder.Sequence", "resolution": "1 arcsec",
})})  # fmt: skip
SWUNG = (
    "200 8 10 00 00 E8 03 00 FF 00",  # 16 at 1000 ticks, sample 255
    "208 6 40 42 0F 00 FF 01",  # 1 000 000 counts, sample 511, of which the samples know the lowest 8 bits
    "200 8 11 00 00 D0 07 00 00 00",  # 17 at 2000 ticks, sample 0: 256 by the one before
    "208 6 A4 42 0F 00 00 02",  # 1 000 100 counts
    "200 8 12 00 00 B8 0B 00 01 00",  # 18; its encoder was lost
    "200 8 13 00 00 A0 0F 00 02 01",  # 19, over range: not to be used, nor its encoder
    "208 6 08 43 0F 00 02 02",
    "200 8 14 00 00 88 13 00 03 00",  # 20 at 5000 ticks
    "208 6 9C FF FF FF 03 02",  # through zero: 100 counts below it
)


def test_the_encoder_belongs_to_the_sample_with_its_number() -> None:
    found = decode_positions(OUTPUT, ENCODER["table"], frames(*SWUNG))
    assert found.sequence.tolist() == [255, 256, 259]
    assert found.tick.tolist() == [1000, 2000, 5000]
    assert found.position.tolist() == [1_000_000, 1_000_100, 2**32 - 100]
    assert found.host_s.tolist() == [0.0, 0.02, 0.07]
    assert (found.tick_bits, found.position_bits, found.lost, found.restarts) == (24, 32, 1, 0)
    assert decode_samples(OUTPUT, frames(*SWUNG)).sequence.tolist() == [255, 256, 257, 259]


def test_without_samples_there_is_no_encoder_and_without_encoders_none_is_guessed() -> None:
    assert decode_positions(OUTPUT, ENCODER["table"], frames(SWUNG[1])).sequence.tolist() == []
    alone = decode_positions(OUTPUT, ENCODER["table"], frames(SWUNG[0], SWUNG[2]))
    assert (alone.sequence.tolist(), alone.lost) == ([], 2)


# Channels that are sampled together


@pytest.mark.parametrize("first", [3, 253, 255])
@pytest.mark.parametrize("begins_with", [0, 1, 2])
def test_channels_sampled_together_have_the_same_numbers_where_a_block_begins_between_them(first, begins_with) -> None:
    """One number of 8 bits wraps around between the frames of the three axes with which the block begins."""
    options = load_bench(ROOT / "config/table_imu_telemetry.yaml").bench.devices["telemetry"].options
    dbc = Dbc((ROOT / "config/table_imu_telemetry.dbc").read_text("utf-8"))
    numbers = first + np.arange(6)
    axis = {"Tick": numbers * 200, "Sequence": numbers, "Acceleration": numbers, "Rate": -numbers}
    encoder = {"Encoder": {"Position": 1000 + numbers, "Sequence": numbers}}
    every = encode_frames(dbc, numbers * 2e-3, {f"Axis{letter}": axis for letter in "XYZ"} | encoder)
    block = every.at(np.arange(begins_with, len(every)))
    decoder = TelemetryDecoder(options)
    samples, positions = decoder.outputs(block), decoder.positions(block)["table"]
    common = samples["ax"].sequence[-5:].tolist()
    for name, found in samples.items():
        assert found.sequence[-5:].tolist() == common, name
        assert found.tick[-5:].tolist() == ((first + 1 + np.arange(5)) * 200).tolist()
    assert positions.sequence[-5:].tolist() == common
    assert positions.position[-5:].tolist() == (1000 + numbers[-5:]).tolist()
