"""Results as text for a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from bench.figures.columns import in_columns
from bench.figures.numbers import shown
from bench.figures.words import of_those_within_u, quantity_of, unit_shown
from bench.metrology.results.finding import UnitResult
from bench.reduce.evaluate import Results
from bench.reduce.journal import JournalRecords
from bench.report.flag_words import flag_in_words
from bench.report.tables import at_dwells, over_run_rows, verdict_rows

SUMMARY_ALIGN = "<><<<"  # name, value, unit, verdict, notes
_AT_DWELLS = ("K0", "K1_si", "K2", "misalignment")  # of more quantities than a line has room for


def results_text(results: Results | None) -> str:
    """Results of a run as a table; uncertainties are expanded (95 %)."""
    if results is None:
        return "No results: the run's data could not be reduced.\n"
    lines: list[str] = []
    for unit in results.units:
        lines += ["", f"{results.title}: {unit.uut} in place {unit.place}: {unit.verdict}", ""]
        lines += _dwell_table(unit)
        lines += _summary_table(unit)
        lines += [f"  {unit.dropped.text}"] if unit.dropped is not None else []
        lines += [f"  {flag_in_words(flag)}" for flag in unit.flags]
    lines += _journal_records(results.journal_records)
    each = dict.fromkeys(f"{unit.uut} {unit.verdict}" for unit in results.units)
    near = f", {of_those_within_u(results.within_u)}" if results.within_u else ""
    return "\n".join(
        [*lines, "", f"Verdict: {results.verdict}{near}" + (f" ({', '.join(each)})" if len(each) > 1 else ""), ""]
    )


def _journal_records(found: JournalRecords) -> Iterator[str]:
    """Single readings with their verdicts, and left-out steps."""
    rows = [
        (
            each.name or each.reading, each.shown, each.unit,
            (each.verdict or "not judged") + (" marginal" if each.marginal else ""),
            f"{each.limits_shown}  ({each.step})".strip(),
        )
        for each in found.measurements
    ]  # fmt: skip
    yield from in_columns(rows, SUMMARY_ALIGN)
    yield from (f"  left out: {each.step}: {each.why}" for each in found.left_out)
    yield from (f"  {each.in_words}" for each in found.interruptions)


def _dwell_table(unit: UnitResult) -> Iterator[str]:
    """One line for each dwell, under two lines of names and units."""
    by_dwell = at_dwells(unit)
    if not by_dwell:
        return
    units = {name: unit_shown(name, found.unit) for at in by_dwell.values() for name, found in at.items()}
    names = {name: quantity_of(found) for at in by_dwell.values() for name, found in at.items()}
    shown_here = _AT_DWELLS if names.keys() & set(_AT_DWELLS) else tuple(names)
    rows = [
        ["set point", "measured", "leg", *(names.get(name, name) for name in shown_here)],
        ["°C", "°C", "", *(units.get(name, "") for name in shown_here)],
    ]
    for found in by_dwell.values():
        at = next(iter(found.values())).at
        set_point = "-" if at["temperature_set_c"] is None else f"{at['temperature_set_c']:.0f}"
        values = [shown(found[name]) if name in found else "-" for name in shown_here]
        rows.append([set_point, f"{at['temperature_c']:.2f}", at["leg"], *values])
    yield from in_columns(rows, ">><" + ">" * len(shown_here))
    yield ""


def _summary_table(unit: UnitResult) -> Iterator[str]:
    """Judged quantities at the dwells, points or visits, the worst of each; then all findings over the run."""
    single = {"dwell", "point", "visit"}
    limits = {found.quantity: found.limits for found in unit.findings if single & found.at.keys() and found.limits}
    units = {found.quantity: found.unit for found in unit.findings}
    judged, over_run = verdict_rows(unit, limits, units), over_run_rows(unit)
    rows = []
    for row, where in [*((row, "") for row in judged), *((row, row.where) for row in over_run)]:
        verdict = row.verdict + (" marginal" if row.marginal else "")
        notes = "; ".join(filter(None, (row.limits, row.bands, row.remark, where)))
        rows.append((row.quantity, row.value, row.unit, verdict, notes))
    yield from in_columns(rows, SUMMARY_ALIGN)
    yield ""
