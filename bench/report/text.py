"""Plans and results as text for a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from bench.analysis.finding import Finding, UnitResult
from bench.report.findings import Results
from bench.report.shown import SHOWN, duration, shown
from bench.report.words import flag_in_words
from bench.sequence.estimate import Estimate
from bench.sequence.plan import Plan

_AT_DWELLS = ("K0", "K1_si", "K2", "misalignment")


def plan_table(plan: Plan, expected: Estimate) -> Iterator[str]:
    """A line for each step: when it begins, how long it takes, what it is."""
    yield f"{'begins':>12}  {'takes':>11}  step"
    begins_s = 0.0
    for planned, takes_s in zip(plan, expected.steps_s, strict=True):
        yield f"{_clock(begins_s):>12}  {duration(takes_s):>11}  {planned.id}"
        begins_s += takes_s


def _clock(seconds: float) -> str:
    whole = round(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02}:{whole % 60:02}"


def results_text(results: Results | None) -> str:
    """The results of a run as a table; every uncertainty is expanded, k = 2."""
    if results is None:
        return "No results: the run's data could not be reduced.\n"
    lines: list[str] = []
    for unit in results.units:
        lines += ["", f"{results.title}: {unit.uut} in place {unit.place}: {unit.verdict}", ""]
        lines += _dwell_table(unit)
        lines += _summary_table(unit)
        lines += [f"  {flag_in_words(flag)}" for flag in unit.flags]
    return "\n".join([*lines, "", f"Verdict: {results.verdict}", ""])


def _dwell_table(unit: UnitResult) -> Iterator[str]:
    by_dwell: dict[str, dict[str, Finding]] = {}
    for finding in unit.findings:
        if "@" in finding.id:
            by_dwell.setdefault(finding.id.partition("@")[2], {})[finding.quantity] = finding
    if not by_dwell:
        return
    heads = "".join(f"{f'{name} / {SHOWN[name][1]}':>28}" for name in _AT_DWELLS)
    yield f"{'set':>6} {'unit':>8}  leg {heads}"
    yield f"{'°C':>6} {'°C':>8}"
    for found in by_dwell.values():
        at = next(iter(found.values())).at
        values = "".join(f"{shown(found[name]) if name in found else '-':>28}" for name in _AT_DWELLS)
        yield f"{at['temperature_set_c']:>6.0f} {at['temperature_c']:>8.2f}  {at['leg']:<4}{values}"
    yield ""


def _summary_table(unit: UnitResult) -> Iterator[str]:
    for finding in unit.findings:
        if "@" not in finding.id:
            _, label = SHOWN.get(finding.quantity, (1.0, finding.unit))
            verdict = (finding.verdict or "") + (" marginal" if finding.marginal else "")
            yield f"  {finding.quantity:<28} {shown(finding):>24} {label:<8} {verdict}"
    yield ""
