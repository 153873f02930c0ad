"""The page of a run: its data, rendered by a template."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from jinja2 import Environment

from bench.figures.languages import current, tr
from bench.figures.plots import Plot
from bench.figures.sheet import Sheet
from bench.figures.svg import drawing, font_of
from bench.figures.templates import environment_of
from bench.figures.times_and_sizes import instant
from bench.figures.words import answer_text, of_those_within_u, quantity_in_words
from bench.metrology.results.curves import TemperatureModel
from bench.metrology.results.finding import UnitResult
from bench.metrology.results.limits import Limits
from bench.metrology.run_data import RunData
from bench.reduce.ambient import ambient_of
from bench.reduce.evaluate import Results
from bench.reduce.journal import JournalRecords, Measurement
from bench.reduce.stored_run import StoredRun
from bench.report import gaps, page, tables
from bench.report.afterwards import Afterwards, lines
from bench.report.approval import certificate
from bench.report.budgets import Budget, BudgetsOfDwells, budget, budgets_of_dwells, budgets_of_points
from bench.report.course import course_of, course_plot
from bench.report.flag_words import flag_in_words
from bench.report.page import Facts
from bench.report.plan_view.timeline import clock
from bench.report.revision import Revision
from bench.sequence.language.values import in_words
from bench.sequence.method import CHANNEL, MethodDescription, known_methods
from bench.sequence.steps.limits import limits_in
from bench.store.runs import BENCH_COPY
from drivers.installed import loaded

TEMPLATE = "report.html.j2"
MOST_NOTES = 12  # shown at the top of the page; others are folded


@dataclass(frozen=True)
class UnitSection:
    """Section of one unit and method; `name` is unique in the page."""

    name: str
    result: UnitResult
    verdicts: tuple[tables.Row, ...]
    shown: tuple[Plot | Sheet, ...]
    dwells: tables.DwellTable | None
    over_run: tuple[tables.Row, ...]
    models: tuple[tables.ModelTable, ...]
    model_sheets: tuple[Sheet, ...]
    budgets: tuple[Budget, ...]
    budgets_of_dwells: tuple[BudgetsOfDwells, ...]


def render(
    run: StoredRun,
    results: Results | None,
    not_evaluated: str,
    revision: Revision,
    after: Afterwards,
    approval: Mapping[str, Any] | None = None,
    *,
    is_copy: bool = False,
) -> str:
    """Render the whole page; without results `not_evaluated` gives the reason.

    With an `approval` it has a certificate; one that `is_copy` is not the approved report, and states so. Equal runs
    give equal pages, except for wall-clock times.
    """
    data = _data(run) if results is not None else []
    instruments = page.instruments(run)
    verdict = results.verdict if results is not None else run.manifest["verdict"] or "INCOMPLETE"
    with drawing():
        course = course_plot(run, course_of(run, data))
    sections = list(_sections(run, results)) if results is not None else []
    journal_records = results.journal_records if results is not None else JournalRecords()
    not_come = results.missed if results is not None else ()
    problems = list(page.problems(run, not_evaluated, verdict))
    notes = [
        *page.past_due(instruments), *page.faults_on_purpose(run), *page.repetitions(run), *page.power(run),
        *page.left_on(run), *page.notes_of_steps(run), *gaps.lines(not_come), *_flags(results),
    ]  # fmt: skip
    return _environment().get_template(TEMPLATE).render(
        manifest=run.manifest,
        number=_number(run, revision, approval, is_copy=is_copy),
        **_approved(run, approval, is_copy=is_copy),
        head=head(run, revision, journal_records.measurements, deviates=bool(problems or notes)),
        verdict=verdict,
        within_u=of_those_within_u(results.within_u) if results is not None and results.within_u else "",
        simulated=page.simulated(run.manifest, list(run.bench.devices)),
        problems=problems,
        notes=notes,
        most_notes=MOST_NOTES,
        after=list(lines(after, run.bench.site.time_zone)),
        is_late=after.is_late,
        times=page.times(run),
        site=page.site(run),
        instruments=instruments,
        corrections=list(run.corrections()) if results is not None else [],
        missed=list(gaps.sheets(not_come, run.reader.span_s()[0])),
        course=course,
        sections=sections,
        journal_records=journal_records,
        provenance=page.provenance(run, data),
        documents=_documents(run),
        meanings=_meanings(run),
        language=current(),
        figures_are_foreign=font_of(current()) is None,
    )  # fmt: skip


def _number(run: StoredRun, revision: Revision, approval: Mapping[str, Any] | None, *, is_copy: bool) -> str:
    """Identification on every page: the number of an approved report, else run and revision."""
    if approval is not None and not is_copy:
        return str(approval["report"])
    return tr("{run}, revision {number}", run=run.manifest["run"], number=revision.number)


def _approved(run: StoredRun, approval: Mapping[str, Any] | None, *, is_copy: bool) -> dict[str, object]:
    """What a template shows of an approval: certificate, mark, the line of the person, and what a copy is a copy of."""
    if approval is None:
        return {"certificate": [], "mark": "", "copy_of": "", "approved": None}
    manifest, zone = run.manifest, run.bench.site.time_zone
    dates = " – ".join(dict.fromkeys(instant(manifest[each], zone)[:10] for each in ("started", "ended")))
    recorded = {"order": manifest.get("order") or "", "calibrated": dates, "ambient": _ambient(run)}
    return {
        "certificate": list(certificate(approval, recorded)),
        "mark": approval["laboratory"].get("mark", ""),
        "copy_of": approval["report"] if is_copy else "",
        "approved": None if is_copy else {
            "by": approval["by"],
            "at": instant(approval["at"], zone),
            "signed": tr("electronic, in this PDF") if approval.get("signature") else "",
        },
    }  # fmt: skip


@lru_cache(maxsize=1)
def _environment() -> Environment:
    return environment_of("bench.report", clock=clock, answer_text=answer_text)


def _data(run: StoredRun) -> list[RunData]:
    """Acquisitions under the labels that the sequence evaluates."""
    return [run.data(label) for label in dict.fromkeys(each for entry in run.sequence.results for each in entry.labels)]


def _meanings(run: StoredRun) -> list[str]:
    """Contents of the results of the run's methods, each text once."""
    return list(dict.fromkeys(known_methods()[entry.method].meaning for entry in run.sequence.results)) or [CHANNEL]


def _sections(run: StoredRun, results: Results) -> Iterator[UnitSection]:
    """A section for each unit and method; every method gives one result for each unit."""
    entries = [entry for entry in run.sequence.results for _ in run.serials]
    for number, (entry, unit) in enumerate(zip(entries, results.units, strict=True)):
        method = known_methods()[entry.method]
        bench, place = run.bench, unit.place
        in_units = method.units(bench.output_unit(place), bench.gyro_output_unit(place), bench.circuit_unit(place))
        limits = {name: limits_in(limit, in_units[name]) for name, limit in entry.limits.items()}
        yield _section(unit, f"{unit.place}-{number}", limits, in_units, method)


def _section(
    unit: UnitResult, name: str, limits: Mapping[str, Limits], in_units: Mapping[str, str], method: MethodDescription
) -> UnitSection:
    dwells = tables.at_dwells(unit)
    first = next(iter(dwells.values()), {})
    numbers = tables.dwell_numbers(unit)
    return UnitSection(
        name=name,
        result=unit,
        verdicts=tuple(tables.verdict_rows(unit, limits, in_units)),
        shown=tuple(_drawn(method, unit, name)),
        dwells=tables.dwell_table(unit),
        over_run=tuple(tables.over_run_rows(unit)),
        models=tuple(tables.model_table(model) for model in unit.models if isinstance(model, TemperatureModel)),
        model_sheets=tuple(
            tables.model_sheet(model) for model in unit.models if not isinstance(model, TemperatureModel)
        ),
        budgets=tuple(budget(each, numbers) for each in [*first.values(), *tables.over_run(unit)] if each.budget),
        budgets_of_dwells=(
            *(tuple(budgets_of_dwells(unit, quantity) for quantity in first) if len(dwells) > 1 else ()),
            *(budgets_of_points(found) for found in tables.at_points(unit).values()),
        ),
    )


def _drawn(method: MethodDescription, unit: UnitResult, name: str) -> Iterator[Plot | Sheet]:
    """Plots and tables of the method for a unit; `name` is the prefix of their ids in the page."""
    if method.drawn_by:
        with drawing():
            yield from loaded(method.drawn_by)(unit, name)


def _flags(results: Results | None) -> Iterator[str]:
    units = results.units if results is not None else ()
    flagged: dict[str, list[str]] = {}
    for unit in units:
        for flag in unit.flags:
            flagged.setdefault(flag_in_words(flag), []).append(unit.uut)
    for words, uuts in flagged.items():
        yield f"{', '.join(dict.fromkeys(uuts))}: {words}" if len(units) > 1 else words


def _documents(run: StoredRun) -> list[tuple[str, str]]:
    """Unchanged copies of files kept in a run."""
    bench = (run.folder / BENCH_COPY).read_text(encoding="utf-8", errors="replace")
    return [
        (tr("The sequence as it was run"), run.document.text),
        (tr("The bench file as it was run"), bench),
    ]


def head(run: StoredRun, revision: Revision, measured: Sequence[Measurement], *, deviates: bool) -> Facts:
    """Entries of the head; `deviates` is true if the report lists deviations."""
    manifest = run.manifest
    issued = instant(revision.issued.isoformat(), run.bench.site.time_zone)
    return [
        (tr("Issued"), issued),
        (tr("Order"), manifest.get("order") or tr("not stated")),
        (tr("Procedure"), manifest.get("procedure") or tr("not stated")),
        (tr("Method"), tr("; ").join(dict.fromkeys(_methods(run))) or tr("none")),
        (
            tr("Decision rule"),
            tr("; ").join(dict.fromkeys(_decision_rules(run, measured))) or tr("none: nothing is judged"),
        ),
        *_specified_drift(run),
        (tr("Ambient conditions"), _ambient(run) or tr("not recorded")),
        (tr("Deviations"), tr("see below") if deviates else tr("none recorded")),
    ]


def _methods(run: StoredRun) -> Iterator[str]:
    """Methods with the standards that they follow; conformity to these is not claimed."""
    for entry in run.sequence.results:
        method = known_methods()[entry.method]
        if method.after:
            yield tr("{method}, after {standards}", method=tr(method.title), standards=", ".join(method.after))
        else:
            yield tr(method.title)


def _decision_rules(run: StoredRun, measured: Sequence[Measurement]) -> Iterator[str]:
    """Decision rule for each kind of limit of results and single measurements."""
    of_results = [limit for entry in run.sequence.results for limit in entry.limits.values()]
    of_measurements = [found.limits for found in measured if found.limits is not None]
    guards = [limit.guard for limit in of_results if limit.sides != (None, None)]
    guards += [found.get("guard") for found in of_measurements if (found.get("min"), found.get("max")) != (None, None)]
    for guard_k in guards:
        if guard_k is None:
            yield tr("simple acceptance: a value inside its limits passes")
        else:
            yield tr("guarded acceptance: a value passes that is inside its limits by {k} u", k=f"{guard_k:g}")
    if any(limit.u_max is not None for limit in of_results) or any(found.get("u_max") for found in of_measurements):
        yield tr("where a limit has u_max: a value passes only if its standard uncertainty is at most that")


def _specified_drift(run: StoredRun) -> Facts:
    """Specified drifts of the results; empty without any."""
    stated = {name: value for entry in run.sequence.results for name, value in entry.monthly_drift.items()}
    if not stated:
        return []
    each = [f"{quantity_in_words(name)} {value.written or in_words(value)}" for name, value in stated.items()]
    words = tr("{drifts} a month; a specification, no part of values or uncertainties", drifts=tr(", ").join(each))
    return [(tr("Specified drift"), words)]


def _ambient(run: StoredRun) -> str:
    """Ambient conditions over the run; empty if none were recorded."""
    return tr("; ").join(each.in_words for each in ambient_of(run.reader, run.bench))
