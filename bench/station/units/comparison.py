"""Comparison of two runs: the same results side by side."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime
from typing import Any, NamedTuple

from pydantic import BaseModel, ConfigDict, Field

from bench.errors import StoreError
from bench.station.runs.findings import RESULTS, FindingView, read_findings
from bench.station.units.history import Identities, calibration_of, without_place
from bench.station.units.trends import Calibration, e_n
from bench.store.runs import BENCH_COPY, SEQUENCE_COPY, RunSummary


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True)


class ComparedView(_Model):
    """Result in two runs; one of them may lack it."""

    id: str = Field(description="id of the result without the place of the unit")
    quantity: str
    name: str
    at: dict[str, Any]
    unit: str
    first: FindingView | None
    second: FindingView | None
    difference: float | None = Field(description="second minus first")
    e_n: float | None = Field(description="difference by its expanded uncertainty; null if it has none")


class Comparison(_Model):
    """Two runs side by side; `differs` are facts of the runs that are not equal."""

    first: str
    second: str
    same_unit: bool = Field(description="E_n then shows a change of the unit, otherwise a difference of two units")
    differs: dict[str, tuple[str, str]]
    results: list[ComparedView]
    problems: list[str] = []


def compare(first: RunSummary, second: RunSummary) -> Comparison:
    """Compare the results of two runs. For several units, those in the same place are compared."""
    found, problems = [], []
    for run in (first, second):
        try:
            found.append(_by_id(run))
        except StoreError as problem:
            problems.append(str(problem))
            found.append({})
    one, other = (_Side(run, Identities(run.manifest)) for run in (first, second))
    results = [_compared(one, other, key, found[0].get(key), found[1].get(key)) for key in {**found[0], **found[1]}]
    return Comparison(
        first=first.id, second=second.id, same_unit=first.units == second.units, results=results, problems=problems,
        differs=dict(_differences(first.manifest, second.manifest)),
    )  # fmt: skip


def _by_id(run: RunSummary) -> dict[str, FindingView]:
    found, places = read_findings(run.path / RESULTS)
    alone = len(places) == 1
    return {without_place(each.id, places) if alone else each.id: each for each in found}


class _Side(NamedTuple):
    """One of two runs, with the errors of its instruments."""

    run: RunSummary
    identities: Identities

    def calibration(self, finding: FindingView) -> Calibration:
        begun = datetime.fromisoformat(str(self.run.manifest["started"]))
        return calibration_of(begun, finding, self.identities)


def _compared(
    first: _Side, second: _Side, key: str, one: FindingView | None, other: FindingView | None
) -> ComparedView:
    both = one is not None and other is not None and one.unit == other.unit
    some = other or one
    assert some is not None  # noqa: S101  one of the runs has it
    comparable = both and one is not None and other is not None and "INVALID" not in (one.verdict, other.verdict)
    return ComparedView(
        id=key, quantity=some.quantity, name=some.name, at=some.at, unit=some.unit, first=one, second=other,
        difference=other.value - one.value if both and one and other else None,
        e_n=e_n(first.calibration(one), second.calibration(other)) if comparable and one and other else None,
    )  # fmt: skip


def _differences(one: Mapping[str, Any], other: Mapping[str, Any]) -> Iterator[tuple[str, tuple[str, str]]]:
    facts = ("title", "sequence", "bench", "preset", "operator", "order", "verdict")
    for name in facts:
        if one.get(name) != other.get(name):
            yield name, (str(one.get(name) or ""), str(other.get(name) or ""))
    for name, key in (("parameters", "parameter"), ("software", "software"), ("hashes", "file")):
        before, now = one.get(name, {}), other.get(name, {})
        for each in sorted({*before, *now}):
            if before.get(each) != now.get(each) and (name != "hashes" or each in (BENCH_COPY, SEQUENCE_COPY)):
                yield f"{key} {each}", (str(before.get(each, "")), str(now.get(each, "")))
