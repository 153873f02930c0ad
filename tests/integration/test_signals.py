"""A few of the trials of signals and lost terminals, and of what is not safe, on real processes and real wires."""

from __future__ import annotations

import pytest

from campaigns.trials import signals

pytestmark = pytest.mark.integration


def test_a_sample_of_signals_and_terminals_leaves_the_bench_safe():
    rows = list(signals.trials(0.05))
    assert [row.result for row in rows if not row.ok] == []
    assert sum(row.trials for row in rows) >= 3
