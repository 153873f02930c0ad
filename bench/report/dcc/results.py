"""Results of a run in a certificate: for each unit and method the methods, instruments, conditions, values."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

from bench.certificates import dsi
from bench.certificates.markup import Element
from bench.config.models import Gravity
from bench.figures.languages import tr
from bench.figures.words import REASONS, limits_in_words, name_of, quantity_of, unit_shown, where
from bench.metrology.results.coverage import COVERAGE
from bench.metrology.results.finding import LOWER_BOUND, Finding, UnitResult
from bench.metrology.results.limits import Limits
from bench.reduce.ambient import ambient_of
from bench.reduce.evaluate import Results
from bench.reduce.journal import Measurement
from bench.reduce.stored_run import StoredRun
from bench.report.dcc.elements import Number, add, element, quantity, real, say
from bench.report.dcc.instruments import instruments
from bench.report.dcc.numbers import as_reported, converted, scale
from bench.report.tables import dwell_numbers
from bench.sequence.document.model import ResultEntry
from bench.sequence.method import known_methods
from drivers.quantity.units import QuantityError

# Units of the conditions of a result, by the ends of their names.
_CONDITIONS = {"c": "°C", "deg": "°", "dps": "°/s", "g": "g", "hz": "Hz", "s": "s", "a": "A"}
_CONFORMITY = {"PASS": "pass", "FAIL": "fail"}


def measurement_results(parent: Element, run: StoredRun, results: Results) -> None:
    """Add a measurement result for each unit and method, and one for the single measurements."""
    made = add(parent, "dcc:measurementResults")
    entries = [entry for entry in run.sequence.results for _ in run.serials]
    for entry, unit in zip(entries, results.units, strict=True):
        if unit.findings:
            _of_unit(made, run, entry, unit)
    if measured := results.journal_records.measurements:
        _of_measurements(made, run, measured)


def _of_unit(parent: Element, run: StoredRun, entry: ResultEntry, unit: UnitResult) -> None:
    method = known_methods()[entry.method]
    made = add(parent, "dcc:measurementResult")
    say(made, "dcc:name", lambda: tr("{title}, unit {uut}", title=tr(method.title), uut=unit.uut))
    say(made, "dcc:description", lambda: tr(method.meaning))
    used = add(add(made, "dcc:usedMethods"), "dcc:usedMethod")
    say(used, "dcc:name", lambda: tr(method.title))
    for standard in method.after:
        add(used, "dcc:norm", standard)
    for reference in filter(None, (run.manifest.get("procedure"),)):
        add(used, "dcc:reference", reference)
    _surroundings(made, run)
    listed, numbers = add(made, "dcc:results"), dwell_numbers(unit)
    for name in dict.fromkeys(finding.quantity for finding in unit.findings):
        findings = [finding for finding in unit.findings if finding.quantity == name]
        result = add(listed, "dcc:result")
        say(result, "dcc:name", partial(quantity_of, findings[0]))
        data = add(result, "dcc:data")
        for finding in findings:
            _finding(data, finding, run.bench.site.gravity, numbers)
    _calibration_file(listed, run, unit)


def _surroundings(made: Element, run: StoredRun) -> None:
    """Add the software, the instruments and the conditions."""
    software = add(made, "dcc:usedSoftware")
    for name, version in run.manifest["software"].items():
        each = add(software, "dcc:software")
        say(each, "dcc:name", name)
        add(each, "dcc:release", version)
    instruments(made, run)
    conditions = add(made, "dcc:influenceConditions")
    g = run.bench.site.gravity
    gravity = Number(g.value, dsi.written("m/s²").text, g.U / g.k, g.k)
    _condition(conditions, lambda: tr("Local gravity g"), gravity, lambda: tr(g.origin))
    level = run.bench.fixture.level
    tilt = Number(level.value, dsi.written("arcsec").text, level.U / level.k, level.k)
    _condition(conditions, lambda: tr("Level of the fixture"), tilt)
    for reading in ambient_of(run.reader, run.bench):
        unit = dsi.written(reading.unit).text
        for value, words in ((reading.low, "least {name}"), (reading.high, "greatest {name}")):
            number = Number(value, unit, (reading.expanded or 0.0) / COVERAGE, COVERAGE)
            _condition(conditions, partial(_of_reading, words, reading.name), number)


def _of_reading(words: str, name: str) -> str:
    return tr(words, name=tr(name.replace("_", " ")))


def _condition(parent: Element, name: Any, number: Number, description: Any = None) -> None:
    made = add(parent, "dcc:influenceCondition")
    say(made, "dcc:name", name)
    if description is not None:
        say(made, "dcc:description", description)
    quantity(add(made, "dcc:data"), name, number)


def _finding(parent: Element, finding: Finding, gravity: Gravity, numbers: Mapping[str, int]) -> None:
    """Add a result; one that is not determined has its reason in place of a number."""
    made = quantity(parent, lambda: _title(finding, numbers), None)
    number = converted(finding, gravity)
    reasons = partial(_reasons, finding)
    is_value = finding.verdict != "INVALID" and LOWER_BOUND not in finding.flags and number.is_finite
    if not is_value:
        say(made, "dcc:noQuantity", lambda: tr("not determined: {why}", why=reasons() or tr("see the report")))
    else:
        if not finding.u:
            say(made, "dcc:description", lambda: tr("its uncertainty is not determined"))
        elif reasons():
            say(made, "dcc:description", reasons)
        made.append(real(number, finding.id))
    _conditions(made, finding.at, gravity)
    _metadata(made, finding, gravity, is_value=is_value)


def _title(finding: Finding, numbers: Mapping[str, int]) -> str:
    return tr(", ").join(filter(None, (name_of(finding), where(finding.at, numbers))))


def _reasons(finding: Finding) -> str:
    """Flags of a result in words; those without a text are left to the report."""
    return tr("; ").join(tr(REASONS[flag]) for flag in finding.flags if flag in REASONS)


def _conditions(parent: Element, at: Mapping[str, Any], gravity: Gravity) -> None:
    """Add the conditions of a result that are numbers in a unit, such as temperature_c."""
    found = list(_numbers(at, gravity))
    if not found:
        return
    made = add(parent, "dcc:influenceConditions")
    for name, number in found:
        _condition(made, name, number)


def _numbers(at: Mapping[str, Any], gravity: Gravity) -> Iterator[tuple[str, Number]]:
    """Conditions with their units; temperature_u_c is the standard uncertainty of temperature_c."""
    for key, value in at.items():
        name, _, end = key.rpartition("_")
        if end not in _CONDITIONS or name.endswith("_u") or not isinstance(value, (int, float)):
            continue
        factor, text = scale(_CONDITIONS[end], gravity)
        number = Number(factor * value, text, factor * (at.get(f"{name}_u_{end}") or 0.0))
        if number.is_finite:
            yield key, number


def _metadata(parent: Element, finding: Finding, gravity: Gravity, *, is_value: bool) -> None:
    """Add the value in units of local gravity as reported, and the statement of conformity with its limits."""
    made = element("dcc:measurementMetaData")
    if is_value and dsi.written(finding.unit).gravity:
        stated = add(made, "dcc:metaData", refType="itb_reported")
        reported = add(stated, "dcc:data")
        quantity(reported, lambda: tr("as reported, in units of local gravity g"), None).append(
            real(as_reported(finding))
        )
        add(stated, "dcc:nonSIDefinition", "g: local gravity at the place of the calibration")
        add(stated, "dcc:nonSIUnit", finding.unit)
    if finding.limits is not None and finding.verdict in _CONFORMITY:
        stated = add(made, "dcc:metaData", refType="basic_conformity")
        say(stated, "dcc:declaration", partial(_rule, finding, finding.limits))
        add(stated, "dcc:conformity", _CONFORMITY[finding.verdict])
        _limits(stated, finding, finding.limits, gravity)
    if len(made):
        parent.append(made)


def _rule(finding: Finding, limits: Limits) -> str:
    """Limits and decision rule in words."""
    unit = unit_shown(finding.quantity, finding.unit)
    text = limits_in_words(finding.quantity, finding.unit, limits)
    parts = [tr("limits: {limits}", limits=f"{text} {'' if unit == '1' else unit}".strip())] if text else []
    if text and limits.guard_k is None:
        parts.append(tr("simple acceptance: a value inside its limits passes"))
    elif text:
        k = f"{limits.guard_k:g}"
        parts.append(tr("guarded acceptance: a value passes that is inside its limits by {k} u", k=k))
    if limits.u_allowed(finding.value) is not None:
        parts.append(tr("where a limit has u_max: a value passes only if its standard uncertainty is at most that"))
    return tr("; ").join(parts)


def _limits(parent: Element, finding: Finding, limits: Limits, gravity: Gravity) -> None:
    factor, unit = scale(finding.unit, gravity)
    kind = "basic_acceptanceLimit" if limits.guard_k is None else "itb_limit"  # guarded, acceptance is narrower
    sides = (
        ("least", f"{kind}Lower", limits.low),
        ("greatest", f"{kind}Upper", limits.high),
        ("greatest standard uncertainty", "itb_limitUncertainty", limits.u_allowed(finding.value)),
    )
    if all(side is None for _, _, side in sides):
        return
    made = add(parent, "dcc:data")
    for name, ref_type, side in sides:
        if side is not None:
            quantity(made, partial(tr, name), Number(factor * side, unit), refType=ref_type)


def _calibration_file(parent: Element, run: StoredRun, unit: UnitResult) -> None:
    """Add the calibration file of a unit, that programs use for its compensation."""
    path = run.folder / f"calibration_{unit.place}.json"
    if not path.is_file() or not unit.compensations:
        return
    result = add(parent, "dcc:result", refType="itb_calibrationFile")
    say(result, "dcc:name", lambda: tr("Calibration file of the unit"))
    file(add(result, "dcc:data"), "dcc:byteData", path.name, "application/json", path.read_bytes())


def file(parent: Element, tag: str, name: str, kind: str, content: bytes) -> None:
    """Add a file."""
    made = add(parent, tag)
    add(made, "dcc:fileName", name)
    add(made, "dcc:mimeType", kind)
    add(made, "dcc:dataBase64", base64.b64encode(content).decode())


def _of_measurements(parent: Element, run: StoredRun, measured: tuple[Measurement, ...]) -> None:
    """Add the single measurements of the sequence, of readings of the bench or of units."""
    made = add(parent, "dcc:measurementResult")
    say(made, "dcc:name", lambda: tr("Single measurements"))
    _surroundings(made, run)
    data = None
    for each in measured:
        if data is None:
            result = add(add(made, "dcc:results"), "dcc:result")
            say(result, "dcc:name", lambda: tr("Single measurements"))
            data = add(result, "dcc:data")
        _measurement(data, each, run.bench.site.gravity)


def _measurement(parent: Element, found: Measurement, gravity: Gravity) -> None:
    made = quantity(parent, found.name or found.reading, None)
    try:
        factor, unit = scale(found.unit, gravity)
        number = Number(factor * found.value, unit, abs(factor) * (found.u or 0.0), COVERAGE)
    except QuantityError:
        number = Number(float("nan"), "")
    if found.verdict == "INVALID" or not number.is_finite:
        say(made, "dcc:noQuantity", lambda: tr("not determined: {why}", why=tr("see the report")))
        return
    made.append(real(number, found.step))
    if found.verdict in _CONFORMITY:
        stated = add(add(made, "dcc:measurementMetaData"), "dcc:metaData", refType="basic_conformity")
        say(stated, "dcc:declaration", lambda: tr("limits: {limits}", limits=found.limits_shown))
        add(stated, "dcc:conformity", _CONFORMITY[found.verdict])
