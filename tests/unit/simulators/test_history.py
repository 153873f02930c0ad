"""States of a simulated unit over time: kept in a file, and read in parts."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from simulators.units.history import IN_MEMORY_BYTES, PAGE, History

LONG = 40 * PAGE


def filled(rows: int, at_once: int = 7) -> History:
    """A history of the squares of times, half a second apart."""
    history = History(2)
    for begin in range(0, rows, at_once):
        at_s = np.arange(begin, min(begin + at_once, rows)) / 2
        history.go_on(at_s, at_s**2)
    return history


@pytest.mark.parametrize("rows", [1, PAGE - 1, PAGE, PAGE + 1, LONG])
def test_a_part_of_a_history_is_interpolated_as_the_whole(rows):
    history, last_s = filled(rows), (rows - 1) / 2
    whole = history.rows
    assert len(history) == len(whole) == rows
    for begin_s, end_s in (
        (-5.0, -4.0),
        (0.0, 0.0),
        (0.3 * last_s, 0.61 * last_s),
        (last_s, last_s),
        (0.0, last_s + 9),
    ):
        part, at_s = history.around(begin_s, end_s), np.linspace(begin_s, end_s, 50)
        assert np.interp(at_s, *part.T).tolist() == np.interp(at_s, *whole.T).tolist()


def test_a_part_of_a_long_history_is_short_and_the_history_goes_on():
    history = filled(LONG)
    assert len(history.around(1000.0, 1000.0)) <= 4 * PAGE
    history.go_on(np.array([1e6]), np.array([-1.0]))
    assert history.around(1e6, 1e6)[-1].tolist() == history.rows[-1].tolist() == [1e6, -1.0]
    assert history.rows[:-1].tolist() == filled(LONG, at_once=LONG).rows.tolist()


def test_rows_of_two_observers_out_of_order_are_found():
    history = History(2)
    for block in range(100):
        ahead_s = np.arange(10 * block + 10.0, 10 * block + 20.0)
        for at_s in (ahead_s, ahead_s - 10):
            history.go_on(at_s, at_s**2)
    part = history.around(487.0, 487.0)
    assert {486.0, 487.0, 488.0} <= set(part[:, 0].tolist())


def test_memory_does_not_grow_with_a_history():
    history, states = History(8), [np.zeros(100)] * 8
    tracemalloc.start()
    for _ in range(4 * IN_MEMORY_BYTES // (64 * 100)):
        history.go_on(*states)
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert held < IN_MEMORY_BYTES / 2
