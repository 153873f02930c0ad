"""Tables of one unit: verdicts, values at the dwells and over temperature, models."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from bench.figures.languages import tr
from bench.figures.numbers import decimals, is_shown_by_range, range_shown, scale_shown, shown
from bench.figures.sheet import Sheet
from bench.figures.words import (
    CONTENTS,
    REASONS,
    bands_in_words,
    leg_in_words,
    limits_in_words,
    name_of,
    quantity_in_words,
    quantity_of,
    unit_shown,
    where,
)
from bench.metrology.results.coverage import COVERAGE
from bench.metrology.results.curves import Constant, Equation, KnotModel, TemperatureModel
from bench.metrology.results.finding import CONFIDENCE, LOWER_BOUND, Finding, UnitResult
from bench.metrology.results.limits import Limits
from bench.sequence.method import MethodWords, texts_of

POWERS = "⁰¹²³⁴⁵⁶⁷⁸⁹"
SEVERITY = ("FAIL", "INVALID", "PASS", None)
VARIABLES = MethodWords(  # variables of equations, with their units
    "VARIABLES", {"temperature_c": "temperature / °C", "acceleration_g": "acceleration / g"}
)
WORST = {  # by the kind of place of a finding
    "point": "worst of {count} points; {summary}",
    "end": "worst of {count} ends; {summary}",
    "dwell": "worst of {count} dwells; {summary}",
}


@dataclass(frozen=True)
class Row:
    """A finding, or the worst of its kind, as a line of a table; `verdict` is empty if nothing is judged."""

    quantity: str
    name: str
    value: str
    unit: str
    limits: str
    bands: str
    verdict: str
    marginal: bool = False
    where: str = ""
    remark: str = ""


@dataclass(frozen=True)
class DwellRow:
    """A dwell: its conditions, a value for each quantity, and notes."""

    number: int
    cycle: int
    leg: str
    set_c: str
    temperature_c: str
    values: tuple[str, ...]
    notes: str


@dataclass(frozen=True)
class DwellTable:
    """Table of the dwells; `heads` are quantity, unit and confounded terms of the value."""

    heads: tuple[tuple[str, str, str], ...]
    rows: tuple[DwellRow, ...]


@dataclass(frozen=True)
class ModelTable:
    """A temperature model; `rows` are power, coefficient, its u, the coefficient of that power of T, and its unit."""

    title: str
    unit: str
    model: TemperatureModel
    rows: tuple[tuple[str, str, str, str, str], ...]
    residual_sd: str
    largest_residual: str


def at_dwells(unit: UnitResult) -> dict[int, dict[str, Finding]]:
    """Findings at each dwell, by its number and by quantity."""
    found: dict[int, dict[str, Finding]] = {}
    for finding in unit.findings:
        if "dwell" in finding.at:
            found.setdefault(finding.at["dwell"], {})[finding.quantity] = finding
    return found


def over_run(unit: UnitResult) -> list[Finding]:
    """Findings other than those of a dwell, of a visit of a set point, or of a point of a range or sweep."""
    return [finding for finding in unit.findings if not {"dwell", "visit", "point"} & finding.at.keys()]


def at_points(unit: UnitResult) -> dict[str, list[Finding]]:
    """Findings at points of a range or a sweep, or at visits of set points, by quantity."""
    found: dict[str, list[Finding]] = {}
    for finding in unit.findings:
        if {"point", "visit"} & finding.at.keys():
            found.setdefault(finding.quantity, []).append(finding)
    return found


def dwell_numbers(unit: UnitResult) -> dict[str, int]:
    """Number of each dwell by its path, the part of an id after the @."""
    return {finding.id.partition("@")[2]: finding.at["dwell"] for finding in unit.findings if "dwell" in finding.at}


def verdict_rows(unit: UnitResult, limits: Mapping[str, Limits], units: Mapping[str, str]) -> Iterator[Row]:
    """Worst finding of each quantity that the sequence limits; without one it is not judged.

    `units` are those of the quantities.
    """
    for quantity, allowed in limits.items():
        found = [finding for finding in unit.findings if finding.quantity == quantity]
        if found:
            worst = min(found, key=lambda finding: (SEVERITY.index(finding.verdict), *_margins(finding)))
            yield _row(worst, dwell_numbers(unit), _remark(found))
        else:
            yield Row(
                quantity=quantity_in_words(quantity),
                name="",
                value=tr("not determined"),
                unit=unit_shown(quantity, units[quantity]),
                limits=limits_in_words(quantity, units[quantity], allowed),
                bands=bands_in_words(quantity, units[quantity], allowed),
                verdict="not judged",
            )


def _margins(finding: Finding) -> tuple[float, float]:
    """Distance from a value to its limits, negative outside, and from its u to the largest permitted."""
    if finding.limits is None:
        return 0.0, 0.0
    allowed = finding.limits.u_allowed(finding.value)
    return finding.limits.room(finding.value), 0.0 if allowed is None else allowed - finding.u


def _remark(found: Sequence[Finding]) -> str:
    """Number of the other findings, and their verdicts."""
    if len(found) == 1:
        return ""
    failed = sum(finding.verdict == "FAIL" for finding in found)
    invalid = sum(finding.verdict == "INVALID" for finding in found)
    marginal = sum(finding.marginal for finding in found)
    summary = [
        tr("{count} failed", count=failed) if failed else "",
        tr("{count} invalid", count=invalid) if invalid else "",
        tr("{count} marginal", count=marginal) if marginal else "",
    ]
    worst = next((text for what, text in WORST.items() if what in found[0].at), "worst of {count}; {summary}")
    return tr(worst, count=len(found), summary=tr(", ").join(filter(None, summary)) or tr("all passed"))


def _row(finding: Finding, dwells: Mapping[str, int], remark: str = "") -> Row:
    limits = finding.limits or Limits()
    reasons = [tr(REASONS[flag]) for flag in finding.flags if flag in REASONS]
    return Row(
        quantity=quantity_of(finding),
        name=name_of(finding),
        value=shown(finding),
        unit=unit_shown(finding.quantity, finding.unit),
        limits=limits_in_words(finding.quantity, finding.unit, limits),
        bands=bands_in_words(finding.quantity, finding.unit, limits),
        verdict=finding.verdict or "",
        marginal=finding.marginal,
        where=where(finding.at, dwells),
        remark=tr("; ").join(filter(None, [*reasons, remark, _interval_in_words(finding)])),
    )


def _interval_in_words(finding: Finding) -> str:
    """Range of a largest value, and its value from scatter alone; empty for any other finding."""
    interval = finding.interval
    if interval is None:
        return ""
    low, high, scatter = range_shown(finding, interval, interval.low, interval.high, interval.from_scatter)
    if is_shown_by_range(finding):
        if LOWER_BOUND in finding.flags:
            return ""
        return tr(
            "in brackets the range of {share}; scatter alone makes {scatter}",
            share=f"{CONFIDENCE:.0%}", scatter=scatter,
        )  # fmt: skip
    return tr(
        "{share}: {low} to {high}; scatter alone makes {scatter}",
        share=f"{CONFIDENCE:.0%}", low=low, high=high, scatter=scatter,
    )  # fmt: skip


def over_run_rows(unit: UnitResult) -> list[Row]:
    """Findings over temperature."""
    dwells = dwell_numbers(unit)
    return [_row(finding, dwells) for finding in over_run(unit)]


def dwell_table(unit: UnitResult) -> DwellTable | None:
    """Every quantity at every dwell; None without a dwell."""
    dwells = at_dwells(unit)
    if not dwells:
        return None
    kinds = {quantity: finding for found in dwells.values() for quantity, finding in found.items()}
    heads = tuple(
        (quantity_of(finding), unit_shown(quantity, finding.unit), _contents(finding))
        for quantity, finding in kinds.items()
    )
    return DwellTable(heads, tuple(_dwell_row(number, found, tuple(kinds)) for number, found in dwells.items()))


def _contents(finding: Finding) -> str:
    return tr(", ").join(tr(CONTENTS[flag]) for flag in finding.flags if flag in CONTENTS)


def _dwell_row(number: int, found: Mapping[str, Finding], quantities: Sequence[str]) -> DwellRow:
    at = next(iter(found.values())).at
    expanded_c = COVERAGE * at["temperature_u_c"]
    digits = decimals(expanded_c)
    return DwellRow(
        number=number,
        cycle=at["cycle"],
        leg=leg_in_words(at["leg"]),
        set_c="–" if at["temperature_set_c"] is None else f"{at['temperature_set_c']:g}",
        temperature_c=f"{at['temperature_c']:.{digits}f} ± {expanded_c:.{digits}f}",
        values=tuple(shown(found[quantity]) if quantity in found else "–" for quantity in quantities),
        notes=tr("; ").join(note for finding in found.values() for note in _notes(finding)),
    )


def _notes(finding: Finding) -> Iterator[str]:
    if finding.verdict in ("FAIL", "INVALID"):
        yield f"{finding.quantity} {tr(finding.verdict)}"
    if finding.marginal:
        yield f"{finding.quantity} {tr('marginal')}"
    for flag in finding.flags:
        if flag not in CONTENTS:
            yield f"{finding.quantity}{tr(': ')}{tr(REASONS[flag]) if flag in REASONS else flag}"


def _form(model: Equation) -> str:
    """The equation with the explanations of its symbols."""
    known = texts_of("FORMS", ())
    clauses = (tr(each.code, **each.values) if each.code in known else str(each) for each in model.clauses)
    return tr(", ").join((model.form, *clauses))


def model_sheet(model: Equation | KnotModel) -> Sheet:
    """Constants of an equation, or knots of a piecewise linear model."""
    if isinstance(model, Equation):
        valid = tr(", ").join(_range_in_words(name, *ends) for name, ends in model.valid.items())
        rows = tuple((_symbol(name), *_constant(each), each.unit) for name, each in model.constants.items())
        return Sheet(
            f"{quantity_in_words(model.quantity)}{tr(': ')}{_form(model)}",
            tr("Valid for {valid}.", valid=valid) if valid else "",
            ((tr("Constant"), ""), (tr("Value"), ""), ("u", "k = 1"), (tr("Unit"), "")),
            rows,
        )
    factor, unit = scale_shown(model.quantity, model.unit)
    knots = zip(model.knots_c, model.values, model.u, strict=True)
    return Sheet(
        tr("{what}, over temperature", what=quantity_in_words(model.quantity)),
        tr("Straight lines between the knots; outside them the end values, with a warning."),
        ((tr("Temperature"), "°C"), (tr("Value"), unit), ("u", f"{unit}, k = 1")),
        tuple((f"{at_c:.2f}", *_constant(Constant(value * factor, unit, u * factor))) for at_c, value, u in knots),
    )


def _range_in_words(name: str, low: float, high: float) -> str:
    """Range of a variable of an equation; temperatures to hundredths of a degree."""
    form = ".2f" if name == "temperature_c" else ".6g"
    ends = tr("{low} to {high}", low=format(low, form), high=format(high, form))
    return f"{tr(VARIABLES[name] if name in VARIABLES else name.replace('_', ' '))} {ends}"


def _symbol(name: str) -> str:
    """Symbol of a constant in its equation, followed by its translation if there is one."""
    translated = tr(name.replace("_", " "))
    return name if translated in (name, name.replace("_", " ")) else f"{name} ({translated})"


def _constant(constant: Constant) -> tuple[str, str]:
    """A value and its u, to the digits that u justifies."""
    if not constant.u:
        return f"{constant.value:.9g}", tr("not known") if constant.u is None else "0"
    digits = 1 - math.floor(math.log10(constant.u))
    if -1 <= digits <= 12:
        return f"{constant.value:.{max(digits, 0)}f}", f"{constant.u:.{max(digits, 0)}f}"
    return f"{constant.value:.9g}", f"{constant.u:.2g}"


def model_table(model: TemperatureModel) -> ModelTable:
    """Coefficients of a model, in the variable of its fit and in powers of T."""
    factor, unit = scale_shown(model.quantity, model.unit)
    us = model.u or (0.0,) * len(model.coefficients)
    rows = []
    for power, (coefficient, u, of_t) in enumerate(zip(model.coefficients, us, model.powers_of_t, strict=True)):
        digits = decimals(u * factor)
        value = f"{coefficient * factor:.{digits}f}" if u else f"{coefficient * factor:.9g}"
        per = f"{unit}/°C{POWERS[power] if power > 1 else ''}" if power else unit
        rows.append(
            (str(power), value, f"{u * factor:.{digits}f}" if u else tr("not known"), f"{of_t * factor:.9g}", per)
        )
    degree, largest = len(model.coefficients) - 1, f"{model.max_residual * factor:.3g} {unit}"
    form = tr("straight line") if degree == 1 else tr("polynomial of degree {degree}", degree=degree)
    return ModelTable(
        title=f"{model.quantity}{tr(': ')}{form}",
        unit=unit,
        model=model,
        rows=tuple(rows),
        residual_sd=tr("not known") if model.residual_sd is None else f"{model.residual_sd * factor:.3g} {unit}",
        largest_residual=largest if model.dof else tr("none: it passes through every point"),
    )
