"""Uncertainty budgets as tables: of one finding, or of a quantity at all dwells side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bench.figures.languages import tr
from bench.figures.numbers import decimals, scale_shown
from bench.figures.words import name_of, quantity_of, shared_in_words, source_in_words, where
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Finding, UnitResult


@dataclass(frozen=True)
class BudgetRow:
    """A source of uncertainty; a confounded term has no `u`."""

    source: str
    type: str
    u: str
    share: str
    dof: str
    shared: str


@dataclass(frozen=True)
class Budget:
    """The budget of one finding."""

    quantity: str
    name: str
    where: str
    unit: str
    rows: tuple[BudgetRow, ...]
    u: str
    expanded: str
    k: str
    dof: str


@dataclass(frozen=True)
class BudgetsOfDwells:
    """Budgets of a quantity at all dwells or points: for each the u by source, the combined u, and its dof.

    `head` is the heading of the first column.
    """

    head: str
    title: str
    unit: str
    sources: tuple[str, ...]
    rows: tuple[tuple[str, tuple[str, ...], str, str], ...]


def budget(finding: Finding, dwells: Mapping[str, int]) -> Budget:
    """Budget of a finding in its displayed unit."""
    factor, unit = scale_shown(finding.quantity, finding.unit)
    digits = decimals(finding.u * factor) + 1
    return Budget(
        quantity=quantity_of(finding),
        name=name_of(finding),
        where=where(finding.at, dwells),
        unit=unit,
        rows=tuple(_budget_row(line, finding, factor, digits) for line in finding.budget),
        u=f"{finding.u * factor:.{digits}f}",
        expanded=f"{finding.expanded * factor:.{decimals(finding.expanded * factor)}f}",
        k=f"{finding.k:.2f}",
        dof=_dof(finding.dof),
    )


def _budget_row(line: BudgetLine, finding: Finding, factor: float, digits: int) -> BudgetRow:
    if line.type == "alias":
        return BudgetRow(source_in_words(line.source), "alias", "", "", "", "")
    share = 100 * line.u**2 / finding.u**2
    return BudgetRow(
        source=source_in_words(line.source),
        type=line.type,
        u=_small(line.u * factor, digits),
        share=_small(share, 1),
        dof=_dof(line.dof),
        shared=shared_in_words(line.shared or ""),
    )


def _small(value: float, digits: int) -> str:
    """A number with `digits` decimals; one that would round to zero is given as less than the last digit."""
    least = 10.0**-digits
    return f"< {least:.{digits}f}" if 0 < value < least / 2 else f"{value:.{digits}f}"


def _dof(dof: int | None) -> str:
    return "∞" if dof is None else str(dof)


def budgets_of_dwells(unit: UnitResult, quantity: str) -> BudgetsOfDwells:
    """Budgets of one quantity side by side."""
    found = [finding for finding in unit.findings if finding.quantity == quantity and "dwell" in finding.at]
    return _side_by_side(found, tr("Dwell"), [str(finding.at["dwell"]) for finding in found])


def budgets_of_points(found: Sequence[Finding]) -> BudgetsOfDwells:
    """Budgets of one quantity at the points of a range or a sweep, or at visits of set points, side by side."""
    return _side_by_side(found, tr("Point"), [where(finding.at, {}) for finding in found])


def _side_by_side(found: Sequence[Finding], head: str, names: Sequence[str]) -> BudgetsOfDwells:
    quantity = found[0].quantity
    factor, unit = scale_shown(quantity, found[0].unit)
    digits = decimals(min(finding.u for finding in found) * factor) + 1
    sources = tuple(dict.fromkeys(line.source for each in found for line in each.budget if line.type != "alias"))
    rows = []
    for finding, name in zip(found, names, strict=True):
        of_source = {line.source: _small(line.u * factor, digits) for line in finding.budget}
        cells = tuple(of_source.get(source, "–") for source in sources)
        rows.append((name, cells, f"{finding.u * factor:.{digits}f}", _dof(finding.dof)))
    return BudgetsOfDwells(
        head, quantity_of(found[0]), unit, tuple(map(source_in_words, sources)),
        tuple(rows),
    )  # fmt: skip
