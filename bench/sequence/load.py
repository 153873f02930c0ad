"""Load a sequence file and expand it to a plan with the parameters of a run."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path

from bench.config.document import Document, Problem, parse_document, read_document
from bench.config.load import load
from bench.config.models import BenchFile
from bench.errors import InputError
from bench.sequence.checks.check import check
from bench.sequence.checks.remarks import Remark
from bench.sequence.checks.rules import judge
from bench.sequence.document.model import CONTEXT, Outline, SequenceFile
from bench.sequence.document.outline import block_around, outline_of
from bench.sequence.language.expressions import Value, ValueProblem
from bench.sequence.language.readings import example_of
from bench.sequence.language.values import value_of
from bench.sequence.plan.expand import expand
from bench.sequence.plan.plan import Plan
from bench.sequence.plan.unit_places import occupied
from drivers.schema.suggest import did_you_mean
from drivers.schema.wording import value_text


def load_sequence(path: Path) -> tuple[Document, SequenceFile]:
    """Load a sequence file without evaluating expressions; InputError lists every problem with its place."""
    document = read_document(path)
    return document, load(document, SequenceFile, **CONTEXT, files_needed=False)


def load_judged_plan(
    path: Path,
    bench: BenchFile | None,
    *,
    preset: str | None = None,
    parameters: Path | None = None,
    settings: Iterable[str] = (),
    places: Collection[str] = (),
) -> tuple[Plan, tuple[Remark, ...]]:
    """Plan of a file, checked against a bench, and warnings; without a bench, only checks that need none are made.

    A parameter has its default unless the preset, the file `parameters` (a mapping of names to values) or one of
    `settings` (`name=value` as given to --set) sets it; the last of these counts. Units are in `places` of the bench,
    or where `occupied` puts them if none is named. InputError lists every problem of reading, choosing, unrolling and
    checking: an invalid step is left out, and the rest is checked. Rules on the whole plan are applied only to a
    complete plan.
    """
    document = read_document(path)
    outline, found = outline_of(document)
    broken = {block for place, _ in found if (block := block_around(place)) is not None}
    wishes, chosen = _choose(outline, preset, parameters, settings)
    found += _preset_problems(outline)
    plan, unrolling = expand(document, outline, chosen, preset, broken, lambda name: example_of(name, bench))
    bench = occupied(bench, outline, places) if bench is not None else None
    found += [*unrolling, *check(plan, bench)]
    if wishes or found:
        raise InputError(*wishes, *document.located(found))
    remarks = judge(plan, bench) if bench is not None else ()
    if errors := [(remark.place, remark.text) for remark in remarks if remark.severity == "error"]:
        raise InputError(*document.located(errors))
    return plan, remarks


def _choose(
    outline: Outline, preset: str | None, parameters: Path | None, settings: Iterable[str]
) -> tuple[list[str], dict[str, Value]]:
    """Problems of preset and settings, and the value of each parameter."""
    values: dict[str, Value] = {name: parameter.default for name, parameter in outline.parameters.items()}
    found: list[str] = []
    if preset is not None and preset in outline.presets:
        chosen = outline.presets[preset].set
        values.update({name: value for name, value in chosen.items() if not _problem(outline, name, value)})
    elif preset is not None:
        found.append(f"there is no preset '{preset}'{did_you_mean(preset, outline.presets)}")
    if parameters is not None:
        problems_there, given = _from_file(outline, parameters)
        found += problems_there
        values.update(given)
    already: set[str] = set()
    for setting in settings:
        try:
            name, value = _setting(outline, setting)
            if name in already:
                raise ValueProblem(f"'{name}' is set twice: give it once")
            already.add(name)
            values[name] = value
        except ValueProblem as problem:
            found.append(f"--set {setting}: {problem}")
        except InputError as error:
            found += error.problems
    return found, values


def _from_file(outline: Outline, path: Path) -> tuple[list[str], dict[str, Value]]:
    """Problems of a file of parameters, and its values."""
    try:
        document = read_document(path)
    except InputError as error:
        return list(error.problems), {}
    if not isinstance(document.value, dict):
        problem = f"is {value_text(document.value)}, expected a mapping of parameters to values"
        return document.located([((), problem)]), {}
    found: list[Problem] = []
    given: dict[str, Value] = {}
    for name, raw in document.value.items():
        try:
            value = value_of(raw)
            problem = _problem(outline, name, value)
        except ValueProblem as refused:
            problem = f"'{name}' {refused}"
        if problem:
            found.append(((name,), problem))
        else:
            given[name] = value
    return document.located(found), given


def _setting(outline: Outline, setting: str) -> tuple[str, Value]:
    """Parse `name=value` with the value as YAML; raises ValueProblem, or InputError for invalid YAML."""
    name, equals, text = setting.partition("=")
    if not equals:
        raise ValueProblem("expected name=value")
    value = value_of(parse_document(text, Path(f"--set {name}")).value)
    if problem := _problem(outline, name.strip(), value):
        raise ValueProblem(problem)
    return name.strip(), value


def _preset_problems(outline: Outline) -> list[Problem]:
    return [
        (("presets", name, "set", key), problem)
        for name, preset in outline.presets.items()
        for key, value in preset.set.items()
        if (problem := _problem(outline, key, value))
    ]


def _problem(outline: Outline, name: str, value: Value) -> str:
    if name not in outline.parameters:
        return f"there is no parameter '{name}'{did_you_mean(name, outline.parameters)}"
    problem = outline.parameters[name].problem_with(value)
    return f"'{name}' {problem}" if problem else ""
