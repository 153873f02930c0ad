"""What is told of latches and samples that did not come."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from bench.figures.languages import language
from bench.metrology.acquisition import Codes, Counts
from bench.metrology.gaps import MOST_LISTED, gap_columns, missed_in
from bench.metrology.missed import Gap, Missed
from bench.reduce.gaps import MissedIn
from bench.report.gaps import lines, sheets
from drivers.can.sequence_numbers import gaps_in

TICKS, TICK_BITS = 10_000, 16


def counts(*came: int, first: int = 0, last: int | None = None) -> Counts:
    """Latches 10 ms apart at 1 kHz, of those from `first` to `last`."""
    sequence = np.array(came, np.int64)
    last = came[-1] if last is None else last
    return Counts(
        sequence, sequence * TICKS % (1 << TICK_BITS), sequence * 10, sequence * 0, sequence * 0.01, TICK_BITS, 24,
        1e-6, 256_000.0, last - first + 1 - len(came), 0, gaps_in(sequence, first, last),
    )  # fmt: skip


def codes(*came: int, invalid: int = 0, lost: int = 0, gaps: object = ()) -> Codes:
    sequence = np.array(came, np.int64)
    return Codes(
        sequence, sequence * TICKS % (1 << TICK_BITS), sequence * 1.0, sequence * 0.01, TICK_BITS, 1e-6, 1.0, lost, 0,
        invalid, gaps=np.array(gaps, np.int64).reshape(-1, 2),
    )  # fmt: skip


def test_nothing_is_told_where_everything_came() -> None:
    assert missed_in(counts(0, 1, 2, 3)) is None
    assert missed_in(codes(0, 1, 3, invalid=1)) is None, "what the unit marked has come"


def test_a_gap_is_told_by_numbers_and_by_both_clocks() -> None:
    found = missed_in(counts(0, 1, 2, 6, 7, 8))
    assert found == Missed("latches", 1, 3, 9, (Gap(3, 5, 0.02, 0.06, 0.04),), ())


def test_the_first_latch_has_nothing_before_it() -> None:
    found = missed_in(counts(2, 3, 4, 5))
    assert found is not None
    assert found.listed == (Gap(0, 1, None, 0.02, None),)
    assert np.isnan(gap_columns(counts(2, 3, 4, 5))["from_s"]).tolist() == [True]


def test_nor_has_the_last_one_anything_behind_it() -> None:
    found = missed_in(counts(0, 1, 2, last=4))
    assert found is not None
    assert found.listed == (Gap(3, 4, 0.02, None, None),)


def test_samples_that_a_unit_marked_have_come() -> None:
    found = missed_in(codes(0, 1, 4, 5, invalid=1, lost=1, gaps=[[3, 3]]))
    assert found == Missed("samples", 1, 1, 6, (Gap(3, 3, 0.01, 0.04, 0.03),), ())


def test_many_gaps_are_counted_and_the_first_are_listed() -> None:
    many = counts(*range(0, 101, 4), first=0)
    found = missed_in(many)
    assert found is not None
    assert (found.gaps, found.lost, len(found.listed)) == (25, 75, MOST_LISTED)
    assert found.listed[-1].first == 4 * MOST_LISTED - 3
    assert len(gap_columns(many)["first"]) == 25


@pytest.mark.parametrize(
    ("acquired", "why"),
    [
        (counts(0, 5), ("too_few_latches",)),
        (replace(counts(0, 1, 2, 5, 6), counter_bits=12), ("ambiguous_gap",)),
        (codes(0, 1, lost=3, gaps=[[2, 4]]), ("too_few_codes",)),
    ],
)
def test_why_a_mean_is_not_used_is_told(acquired: Counts | Codes, why: tuple[str, ...]) -> None:
    found = missed_in(acquired)
    assert found is not None
    assert found.unusable == why


def test_a_dead_band_is_none_of_the_gaps() -> None:
    still = replace(counts(0, 1, 2, 4, 5, 6), positive=np.zeros(6, np.int64))
    found = missed_in(still)
    assert found is not None
    assert found.unusable == ()


def test_the_journal_gives_it_back() -> None:
    found = missed_in(counts(0, 4, 5, last=9))
    assert found is not None
    assert Missed.of_json(json.loads(json.dumps(asdict(found)))) == found


def reported(*acquired: Counts) -> list[MissedIn]:
    found = [(number, missed_in(each)) for number, each in enumerate(acquired)]
    return [MissedIn(f"steps/{number}", "counter", "x", missed) for number, missed in found if missed is not None]


def test_acquisitions_that_are_not_used_are_named() -> None:
    found = reported(counts(0, 1, 3), counts(0, 5))
    with language("en"):
        (line,) = lines(found)
        table, gaps = sheets(found, 0.0)
    assert line == (
        "counter x: 5 of 10 latches lost, in 2 gaps of 2 acquisitions. The means of these are not used: steps/1."
    )
    assert [row[-1] for row in table.rows] == ["used", "fewer than half of its counter readings arrived"]
    assert gaps.rows[0] == ("steps/0", "counter x", "2", "2", "0.010", "0.030", "0.020")
    assert found[1].in_words() == ("steps/1: counter x: 4 of 6 latches lost, in 1 gap; not used: too_few_latches")


def test_tables_stay_short() -> None:
    with language("en"):
        assert len(list(sheets(reported(counts(*range(0, 101, 4))), 0.0))) == 1, "not all of its gaps are listed"
        (table,) = sheets(reported(*[counts(0, 2)] * 50), 0.0)
        assert list(sheets([], 0.0)) == []
    assert len(table.rows) == 40
    assert "10 more are not shown; 'bench export' writes all of them." in table.caption
