"""Comparison of a stored run, reduced again by the present program, with its results at its end."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.errors import StoreError
from bench.reduce.gaps import MissedIn
from bench.reduce.stored_run import StoredRun
from bench.store.kept_json import NUMBER, TEXT, list_of, nullable, object_of, read_kept

RESULTS = "results.json"
ROUNDING = 1e-9  # of the standard uncertainty: differences between processors or libraries for the same equations


@dataclass(frozen=True)
class Found:
    """Compared properties of a finding."""

    value: float
    u: float
    unit: str
    verdict: str | None

    def has_value_of(self, other: Found) -> bool:
        """True if the values agree within rounding."""
        return self.unit == other.unit and abs(self.value - other.value) <= ROUNDING * max(self.u, other.u)

    def has_u_of(self, other: Found) -> bool:
        """True if the standard uncertainties agree within rounding."""
        return self.unit == other.unit and abs(self.u - other.u) <= ROUNDING * max(self.u, other.u)


@dataclass(frozen=True)
class Change:
    """A finding that differs; None if missing before or now."""

    id: str
    before: Found | None
    now: Found | None

    def to_json(self) -> dict[str, Any]:
        """Both, as JSON content."""
        return dataclasses.asdict(self)

    def in_words(self) -> str:
        """Text of the change: "tumble/a/K0: value 0.00105 -> 0.00106 g (+1e-05, 1.2 u); PASS -> FAIL"."""
        before, now = self.before, self.now
        if before is None or now is None:
            return f"{self.id}: {'is new' if before is None else 'is not found any more'}"
        parts = []
        if not now.has_value_of(before):
            change = now.value - before.value
            of_u = f", {abs(change) / before.u:.2g} u" if before.u else ""
            parts.append(f"value {before.value:.9g} -> {now.value:.9g} {now.unit} ({change:+.3g}{of_u})")
        if not now.has_u_of(before):
            parts.append(f"u {before.u:.4g} -> {now.u:.4g} {now.unit}")
        if before.unit != now.unit:
            parts.append(f"unit {before.unit} -> {now.unit}")
        if before.verdict != now.verdict:
            parts.append(f"{before.verdict or 'not judged'} -> {now.verdict or 'not judged'}")
        return f"{self.id}: {'; '.join(parts)}"


@dataclass(frozen=True)
class ReReduction:
    """Re-reduction difference of a run: stored verdict, present verdict, and the findings that differ."""

    run: str
    verdict_before: str | None
    verdict: str
    findings: int
    changes: tuple[Change, ...]
    missed: tuple[MissedIn, ...] = ()
    damage: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """JSON content."""
        return {
            "run": self.run,
            "verdict": {"before": self.verdict_before, "now": self.verdict},
            "findings": self.findings,
            "changes": [change.to_json() for change in self.changes],
            **({"damage": list(self.damage)} if self.damage else {}),
            **({"missed": [each.to_json() for each in self.missed]} if self.missed else {}),
        }

    def in_words(self) -> Iterator[str]:
        """A line for each acquisition with gaps, one for each change, and one for the run."""
        yield from (f"{self.run}: THE RECORD IS DAMAGED: {each}" for each in self.damage)
        yield from (each.in_words() for each in self.missed)
        yield from (change.in_words() for change in self.changes)
        if self.verdict_before is None:
            yield f"{self.run}: no stored results to compare with; {self.findings} findings now, {self.verdict}"
            return
        summary = f"{len(self.changes)} of {self.findings} findings changed" if self.changes else "nothing changed"
        verdict = self.verdict if self.verdict == self.verdict_before else f"{self.verdict_before} -> {self.verdict}"
        yield f"{self.run}: {summary}, {verdict}"


def reduced_again(run: StoredRun, known: Path | None = None) -> ReReduction:
    """Reduce a run and compare value, standard uncertainty and verdict of every finding; nothing is written.

    It is compared with its own results, or with those in the file `known`.

    Differences below `ROUNDING` of the standard uncertainty are ignored. Raises StoreError for data or results that
    cannot be read.
    """
    evaluated = run.evaluate()
    results, missed = evaluated.to_json(), evaluated.missed
    now, kept = _findings(results), _kept(known or run.folder / RESULTS)
    if kept is None:
        return ReReduction(run.manifest["run"], None, results["verdict"], len(now), (), missed, run.damage)
    verdict, before = kept
    pairs = (Change(name, before.get(name), now.get(name)) for name in dict.fromkeys((*before, *now)))
    changes = tuple(change for change in pairs if _differs(change))
    return ReReduction(run.manifest["run"], verdict, results["verdict"], len(now), changes, missed, run.damage)


_RESULTS = object_of(
    {
        "verdict": TEXT,
        "findings": list_of(
            object_of(
                {"id": TEXT, "value": NUMBER, "u": NUMBER, "unit": TEXT, "verdict": nullable(TEXT)},
                ("id", "value", "u", "unit", "verdict"),
            )
        ),
    },
    ("verdict", "findings"),
)


def _kept(path: Path) -> tuple[str, dict[str, Found]] | None:
    """Verdict and findings in a `results.json`; None without one."""
    if not path.is_file():
        return None
    try:
        content = read_kept(path, _RESULTS)
        return str(content["verdict"]), _findings(content)
    except StoreError as problem:
        raise StoreError(f"{path}: is damaged and cannot be compared ({problem})") from problem


def _findings(content: Mapping[str, Any]) -> dict[str, Found]:
    return {
        finding["id"]: Found(float(finding["value"]), float(finding["u"]), finding["unit"], finding["verdict"])
        for finding in content["findings"]
    }


def _differs(change: Change) -> bool:
    before, now = change.before, change.now
    if before is None or now is None:
        return True
    return not (now.has_value_of(before) and now.has_u_of(before) and before.verdict == now.verdict)
