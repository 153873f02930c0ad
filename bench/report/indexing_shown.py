"""What the sweeps on an indexing table have shown of one unit: its lines, what they leave, every attempt."""

from __future__ import annotations

from collections.abc import Iterator

from bench.analysis.finding import UnitResult
from bench.analysis.indexing_static import IndexingDetail
from bench.report.plots import Plot
from bench.report.tables import Sheet


def indexing_shown(unit: UnitResult, name: str) -> Iterator[Plot | Sheet]:
    """Plots and tables; `name` begins the ids in the page."""
    if isinstance(unit.detail, IndexingDetail):
        yield from ()
