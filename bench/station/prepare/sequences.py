"""Sequences that a station offers, with what a person needs to choose one: purpose, presets, parameters, bounds."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ConfigDict, Field

from bench.config.load import shipped
from bench.errors import InputError
from bench.files import mark_of
from bench.sequence.document.model import Parameter, SequenceFile
from bench.sequence.language.expressions import Value
from bench.sequence.language.values import as_written
from bench.sequence.load import load_sequence
from bench.station.settings import Settings
from drivers.quantity.quantities import Quantity
from drivers.quantity.units import customary_unit

HEAD_LINES = 60
MARK = "# "


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True)


class ParameterView(_Model):
    """Parameter of a sequence; values as they are written in a sequence."""

    name: str
    help: str
    default: str
    unit: str = Field(description="unit of the default; empty for none")
    low: str = Field(description="lowest value allowed; empty for none")
    high: str = Field(description="highest value allowed; empty for none")
    is_list: bool
    kind: str = Field(description="quantity, text or truth")


class PresetView(_Model):
    """Preset of a sequence."""

    name: str
    help: str
    values: dict[str, str] = Field(description="values of its parameters")


class SequenceView(_Model):
    """Sequence of a station; `problem` says why it cannot be read, and then the rest is empty."""

    name: str
    title: str = ""
    own: bool = Field(False, description="of the laboratory; otherwise shipped")
    head: str = Field("", description="comment at the head of the file")
    needs: dict[str, str] = Field({}, description="kind of device by role")
    parameters: list[ParameterView] = []
    presets: list[PresetView] = []
    calls: list[str] = Field([], description="files of the sequences that it calls")
    problem: str = ""

    def shown_with(self, preset: str | None) -> dict[str, str]:
        """Return the value of each parameter with a preset, as written."""
        chosen = next((each.values for each in self.presets if each.name == preset), {})
        return {each.name: chosen.get(each.name, each.default) for each in self.parameters}


Mark = tuple[int, int]


class _Kept(NamedTuple):
    mark: Mark
    view: SequenceView


class Sequences:
    """Catalogue of sequences; a file is read again when it has changed."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._kept: dict[Path, _Kept] = {}

    def all(self) -> list[SequenceView]:
        """Return all sequences by name; one of the laboratory replaces a shipped one of the same name."""
        return [self._view(path) for _, path in sorted(self._files().items())]

    def named(self, name: str) -> SequenceView:
        """Return a sequence. Raises InputError."""
        return self._view(self._settings.sequence_file(name))

    def changed(self) -> dict[Path, Mark]:
        """Return the files that were not read since they have changed."""
        found = {path: mark for path in self._files().values() if (mark := mark_of(path)) is not None}
        return {path: mark for path, mark in found.items() if path not in self._kept or self._kept[path].mark != mark}

    def is_own(self, path: Path) -> bool:
        """Return True for a file of the laboratory."""
        return path.parent == self._settings.own_sequences

    def keep(self, path: Path, mark: Mark, view: SequenceView) -> SequenceView:
        """Keep the view of a file as it was when it had this mark, and return it."""
        self._kept[path] = _Kept(mark, view)
        return view

    def _files(self) -> dict[str, Path]:
        folders = [*reversed(shipped("sequences")), self._settings.own_sequences]
        return {path.stem: path for folder in folders for path in folder.glob("*.yaml") if path.is_file()}

    def _view(self, path: Path) -> SequenceView:
        if (mark := mark_of(path)) is None:
            return SequenceView(name=path.stem, problem=f"{path.name}: it cannot be read")
        if (kept := self._kept.get(path)) is not None and kept.mark == mark:
            return kept.view
        return self.keep(path, mark, view_of(path, own=self.is_own(path)))


def views_of(paths: Mapping[Path, bool]) -> list[SequenceView]:
    """Return the views of sequence files, by whether they are of the laboratory. For worker processes."""
    return [view_of(path, own=own) for path, own in paths.items()]


def view_of(path: Path, *, own: bool) -> SequenceView:
    """Return the view of a sequence file; a file that cannot be read has its problem in it."""
    try:
        document, sequence = load_sequence(path)
    except InputError as problem:
        return SequenceView(name=path.stem, own=own, problem=str(problem))
    return SequenceView(
        name=path.stem, title=sequence.title, own=own, head=head_of(document.text), needs=dict(sequence.needs),
        parameters=[_parameter(name, each) for name, each in sequence.parameters.items()],
        presets=list(_presets(sequence)), calls=sorted(set(_calls(document.value))),
    )  # fmt: skip


def head_of(text: str) -> str:
    """Return the comment at the head of a file, without its marks and the line for editors."""
    lines: list[str] = []
    for line in text.splitlines()[:HEAD_LINES]:
        if not line.startswith("#"):
            break
        if not line.startswith("# yaml-language-server"):
            lines.append(line.removeprefix(MARK).removeprefix("#").rstrip())
    return "\n".join(lines).strip("\n")


def purpose_of(head: str) -> str:
    """Return the purpose in a comment head: what follows the word, else the first paragraph after the title."""
    found = re.search(r"^Purpose:?[ \t]+(.+(?:\n[ \t]+.+)*)", head, re.MULTILINE)
    paragraphs = [part for part in re.split(r"\n[ \t]*\n", head.partition("\n")[2]) if part.strip()]
    return " ".join((found[1] if found else next(iter(paragraphs), "")).split())


def _calls(node: Any) -> Iterator[str]:
    """Yield the files that the steps of a part of a sequence call."""
    parts: Iterable[Any] = node.values() if isinstance(node, dict) else node if isinstance(node, list) else ()
    if isinstance(node, dict) and isinstance(node.get("call"), str):
        yield node["call"]
    for part in parts:
        yield from _calls(part)


def _presets(sequence: SequenceFile) -> Iterator[PresetView]:
    for name, preset in sequence.presets.items():
        yield PresetView(name=name, help=preset.help, values={key: written(value) for key, value in preset.set.items()})


def _parameter(name: str, parameter: Parameter) -> ParameterView:
    default = parameter.default
    one = default[0] if isinstance(default, tuple) else default
    kind = "quantity" if isinstance(one, Quantity) else "truth" if isinstance(one, bool) else "text"
    unit = (one.written.partition(" ")[2] or customary_unit(one.dimension)) if isinstance(one, Quantity) else ""
    return ParameterView(
        name=name, help=parameter.help, default=written(default), unit=unit, kind=kind,
        low="" if parameter.min is None else parameter.min.written,
        high="" if parameter.max is None else parameter.max.written, is_list=isinstance(default, tuple),
    )  # fmt: skip


def written(value: Value) -> str:
    """Return a value as it is written in a sequence, a list in brackets."""
    text = as_written(value)
    return f"[{text}]" if isinstance(value, tuple) else text
