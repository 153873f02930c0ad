"""From a file and the choices of a run to a plan."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from bench.config.document import Document, parse_document, read_document
from bench.config.load import load
from bench.errors import InputError
from bench.sequence.expand import expand
from bench.sequence.model import SequenceFile
from bench.sequence.plan import Plan
from bench.sequence.values import Value, ValueProblem, value_of
from drivers.fields import DEFERRED
from drivers.suggest import did_you_mean


def load_sequence(path: Path) -> tuple[Document, SequenceFile]:
    """A sequence file, its expressions not yet evaluated; InputError lists every problem with its place."""
    document = read_document(path)
    return document, load(document, SequenceFile, **DEFERRED)


def load_plan(path: Path, *, preset: str | None = None, settings: Iterable[str] = ()) -> Plan:
    """The plan of a file; `settings` are `name=value` as given to --set. InputError lists every problem."""
    document, sequence = load_sequence(path)
    return expand(document, sequence, choose(document, sequence, preset, settings), preset)


def choose(
    document: Document, sequence: SequenceFile, preset: str | None, settings: Iterable[str]
) -> Mapping[str, Value]:
    """The value of each parameter: the default, overridden by the preset, overridden by --set."""
    values: dict[str, Value] = {name: parameter.default for name, parameter in sequence.parameters.items()}
    found = [
        f"{document.where(('presets', name, 'set', key))}: {problem}"
        for name, entry in sequence.presets.items()
        for key, value in entry.set.items()
        if (problem := _problem(sequence, key, value))
    ]
    if preset is not None:
        if preset not in sequence.presets:
            raise InputError(f"{document.path}: there is no preset '{preset}'{did_you_mean(preset, sequence.presets)}")
        values.update(sequence.presets[preset].set)
    for setting in settings:
        try:
            name, value = _setting(sequence, setting)
            values[name] = value
        except ValueProblem as problem:
            found.append(f"--set {setting}: {problem}")
    if found:
        raise InputError(*found)
    return values


def _setting(sequence: SequenceFile, setting: str) -> tuple[str, Value]:
    """`name=value`, the value as YAML; raises ValueProblem."""
    name, equals, text = setting.partition("=")
    if not equals:
        raise ValueProblem("expected name=value")
    value = value_of(parse_document(text, Path("--set")).value)
    problem = _problem(sequence, name.strip(), value)
    if problem:
        raise ValueProblem(problem)
    return name.strip(), value


def _problem(sequence: SequenceFile, name: str, value: Value) -> str:
    if name not in sequence.parameters:
        return f"there is no parameter '{name}'{did_you_mean(name, sequence.parameters)}"
    problem = sequence.parameters[name].problem_with(value)
    return f"'{name}' {problem}" if problem else ""
