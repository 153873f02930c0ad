"""Results as text for a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from bench.analysis.finding import Finding, UnitResult
from bench.report.findings import Results
from bench.report.flag_words import flag_in_words
from bench.report.measured import OnTheWay
from bench.report.shown import shown
from bench.report.tables import over_run_rows, verdict_rows
from bench.report.words import quantity_of, unit_shown

_AT_DWELLS = ("K0", "K1_si", "K2", "misalignment")


def results_text(results: Results | None) -> str:
    """The results of a run as a table; every uncertainty is expanded, k = 2."""
    if results is None:
        return "No results: the run's data could not be reduced.\n"
    lines: list[str] = []
    for unit in results.units:
        lines += ["", f"{results.title}: {unit.uut} in place {unit.place}: {unit.verdict}", ""]
        lines += _dwell_table(unit)
        lines += _summary_table(unit)
        lines += [f"  {unit.dropped.text}"] if unit.dropped is not None else []
        lines += [f"  {flag_in_words(flag)}" for flag in unit.flags]
    lines += _on_the_way(results.on_the_way)
    each = ", ".join(dict.fromkeys(f"{unit.uut} {unit.verdict}" for unit in results.units))
    return "\n".join([*lines, "", f"Verdict: {results.verdict}" + (f" ({each})" if "," in each else ""), ""])


def _on_the_way(found: OnTheWay) -> Iterator[str]:
    """Single readings with their verdicts, and what was left out."""
    for each in found.measurements:
        verdict = (each.verdict or "not judged") + (" marginal" if each.marginal else "")
        name = each.name or each.reading
        told = f"{each.limits_shown}  ({each.step})".strip()
        yield f"  {name:<28} {each.shown:>24} {each.unit:<10} {verdict:<14} {told}"
    yield from (f"  left out: {each.step}: {each.why}" for each in found.left_out)


def _dwell_table(unit: UnitResult) -> Iterator[str]:
    by_dwell: dict[str, dict[str, Finding]] = {}
    for finding in unit.findings:
        if "dwell" in finding.at:
            by_dwell.setdefault(finding.id.partition("@")[2], {})[finding.quantity] = finding
    if not by_dwell:
        return
    units = {name: unit_shown(name, found.unit) for at in by_dwell.values() for name, found in at.items()}
    names = {name: quantity_of(found) for at in by_dwell.values() for name, found in at.items()}
    heads = "".join(f"{' / '.join((names.get(name, name), units.get(name, ''))):>28}" for name in _AT_DWELLS)
    yield f"{'set':>6} {'unit':>8}  leg {heads}"
    yield f"{'°C':>6} {'°C':>8}"
    for found in by_dwell.values():
        at = next(iter(found.values())).at
        values = "".join(f"{shown(found[name]) if name in found else '-':>28}" for name in _AT_DWELLS)
        set_point = "-" if at["temperature_set_c"] is None else f"{at['temperature_set_c']:.0f}"
        yield f"{set_point:>6} {at['temperature_c']:>8.2f}  {at['leg']:<4}{values}"
    yield ""


def _summary_table(unit: UnitResult) -> Iterator[str]:
    """What is judged at the dwells, points or visits, the worst of each; then what is found over all of them."""
    single = {"dwell", "point", "visit"}
    limits = {found.quantity: found.limits for found in unit.findings if single & found.at.keys() and found.limits}
    judged, over_run = verdict_rows(unit, limits), over_run_rows(unit)
    for row, where in [*((row, "") for row in judged), *((row, row.where) for row in over_run)]:
        verdict = row.verdict + (" marginal" if row.marginal else "")
        told = "; ".join(filter(None, (row.limits, row.bands, row.remark, where)))
        yield f"  {row.quantity:<28} {row.value:>24} {row.unit:<10} {verdict:<14} {told}".rstrip()
    yield ""
