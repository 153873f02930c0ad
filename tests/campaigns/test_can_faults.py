"""Counters on bad buses: no frame, gap or pulse is wrong without a word; and each of some bugs is caught."""

from __future__ import annotations

import numpy as np
import pytest

from bench.metrology import pulse_counts as counts
from campaigns.can_faults.campaign import Tally, play
from campaigns.can_faults.story import FAULTS, CounterFault, Fault
from campaigns.can_faults.wide import play_wide
from drivers.can import gap_detection as unbroken
from drivers.can.dbc import Field
from drivers.can.frame_block import FrameBlock
from drivers.can.sequence_numbers import ascending, shortest, unwrapped
from drivers.dialects.can_counter import wire
from drivers.kinds.frame_source import intake as frame_intake
from simulators.faults.frame_faults import FrameFault

SEED = 1
PARTS = 5
CASES = 100


@pytest.mark.parametrize("part", range(PARTS))
def test_nothing_is_wrong_without_a_word_on_a_bad_bus(part: int) -> None:
    tally = play(range(part * CASES, (part + 1) * CASES), SEED)
    assert tally.unexpected == []
    assert tally.outcomes["told"] > 0.1 * tally.outcomes.total(), "or the faults are none"
    assert tally.outcomes["true"] > 0.4 * tally.outcomes.total(), "or everything is refused"
    assert tally.outcomes["unseeable"] < 0.03 * tally.outcomes.total()


def test_counters_of_every_width_are_unwrapped_or_refused() -> None:
    tally = play_wide(range(2000), SEED)
    assert tally.unexpected == []
    assert min(tally.outcomes["true"], tally.outcomes["told"]) > 300


def test_a_case_is_the_same_when_it_is_played_again() -> None:
    first, again = (play([17, 23], SEED) for _ in range(2))
    assert first == again


# Bugs that have been made elsewhere; each must be caught


def caught(kind: Fault, cases: int = 8) -> Tally:
    """So many cases with a fault, which must not pass."""
    first = 1 + FAULTS.index(kind)
    tally = play(range(first, first + cases * (len(FAULTS) + 1), len(FAULTS) + 1), SEED)
    assert tally.unexpected != []
    return tally


def test_gaps_counted_by_time_stamps_are_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    right = wire.latches_of

    def by_arrival(form: wire.CounterFormat, block: FrameBlock) -> wire.Latches:
        found = right(form, block)
        if len(found.rows) < 2:
            return found
        since_s = found.host_s - found.host_s[0]
        numbers = found.raw[0] + np.rint(since_s / np.median(np.diff(since_s))).astype(np.int64)
        return found._replace(numbers=numbers, fresh=np.diff(numbers, prepend=numbers[0] - 1) > 0)

    monkeypatch.setattr(wire, "latches_of", by_arrival)
    tally = caught(FrameFault.LATE)
    assert "are true" in tally.unexpected[0]


def test_a_wrap_that_is_lost_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(counts, "steps_of", lambda cumulative, bits: np.diff(cumulative))
    assert "without a" in caught(FrameFault.FOREIGN).unexpected[0]


def test_frames_that_are_counted_twice_are_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    right = wire._paired

    def counting(form: wire.CounterFormat, other: Field, block: FrameBlock, latches: wire.Latches) -> wire._Paired:
        found = right(form, other, block, latches)
        return found._replace(lost=found.last - found.first + 1 - len(other.message.rows(block)))

    monkeypatch.setattr(wire, "_paired", counting)
    caught(FrameFault.DOUBLED)


def test_a_reset_that_is_taken_for_a_wrap_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    right = wire.latches_of
    monkeypatch.setattr(wire, "latches_of", lambda form, block: right(form, block)._replace(restarts=0))
    assert "nothing was told in spite of: " in "".join(caught(CounterFault.RESET, 16).unexpected)


def test_late_frames_that_are_put_in_place_again_are_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wire, "ascending", lambda numbers: np.ones(len(numbers), dtype=bool))
    caught(FrameFault.LATE)


def test_numbers_that_go_round_in_a_gap_are_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wire, "unwrapped_by_clock", lambda raw, bits, *_: unwrapped(raw, bits))
    caught(FrameFault.BURST, 30)


def test_a_longer_number_than_the_latch_has_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the number of an axis no more is known than the latch tells."""
    right = wire.unwrap_by_neighbours
    monkeypatch.setattr(wire, "unwrap_by_neighbours", lambda rows, raw, _bits, *known: right(rows, raw, 16, *known))
    caught(FrameFault.LOST, 30)


def test_axes_that_go_by_the_latch_before_a_gap_are_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    def beside(rows: np.ndarray, raw: np.ndarray, bits: int, known_rows: np.ndarray, known: np.ndarray) -> tuple:
        near = known[np.maximum(np.searchsorted(known_rows, rows) - 1, 0)]
        numbers = near + shortest(raw - near, bits)
        return numbers, ascending(numbers)

    assert play([2634], 7).unexpected == []
    monkeypatch.setattr(wire, "unwrap_by_neighbours", beside)
    assert "are true" in play([2634], 7).unexpected[0]


def test_frames_that_get_lost_between_two_blocks_are_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    def forgetful(self: frame_intake._Blocks, block: FrameBlock) -> None:
        kept = slice(0, max(len(block) - 1, 0))
        self._queue.put_nowait(FrameBlock(block.ids[kept], block.at_s[kept], block.dlc[kept], block.data[kept]))

    monkeypatch.setattr(frame_intake._Blocks, "put", forgetful)
    assert "frames were handed out" in caught(FrameFault.FOREIGN, 2).unexpected[0]


def test_a_look_that_overlooks_an_axis_that_has_ended_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unbroken.GapDetector, "_as_many", lambda self, other: True)
    assert "were overlooked" in "".join(caught(CounterFault.SILENT_AXIS).unexpected)


def test_a_bus_that_is_off_and_that_nobody_tells_of_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_intake._Blocks, "end", lambda self, problem: self._queue.put_nowait(None))
    caught(CounterFault.BUS_OFF, 20)
