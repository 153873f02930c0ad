"""Findings of a stored run, as they are in its `results.json`, and the reasons of its verdict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from bench.errors import StoreError
from bench.metrology.results.limits import U_TOO_LARGE
from bench.store.kept_json import NUMBER, TEXT, TRUTH, list_of, named, nullable, object_of, read_kept
from bench.store.runs import RunSummary

RESULTS = "results.json"
INVALID = "INVALID"
_ANY = lambda _: ""  # noqa: E731  a form
_LINE = object_of({"source": TEXT, "type": TEXT, "u": NUMBER, "shared": nullable(TEXT)}, ("source", "type", "u"))
_FINDING = object_of(
    {
        "id": TEXT, "uut": TEXT, "quantity": TEXT, "name": TEXT, "value": NUMBER, "unit": TEXT, "u": NUMBER,
        "k": NUMBER, "expanded": NUMBER, "limits": nullable(named(NUMBER)), "verdict": nullable(TEXT),
        "u_max": nullable(NUMBER), "monthly_drift": nullable(NUMBER), "marginal": TRUTH, "flags": list_of(TEXT),
        "budget": list_of(_LINE),
        "at": named(_ANY),
    },
    ("id", "uut", "quantity", "name", "value", "unit", "u", "verdict"),
)  # fmt: skip
_UNIT = object_of({"place": TEXT, "uut": TEXT, "verdict": TEXT, "flags": list_of(TEXT)}, ("place", "uut", "verdict"))
_FORM = object_of(
    {"verdict": TEXT, "units": list_of(_UNIT), "findings": list_of(_FINDING), "left_out": list_of(_ANY)},
    ("verdict", "findings"),
)


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True)


class SourceView(_Model):
    """Line of an uncertainty budget."""

    source: str
    type: str
    u: float
    shared: str | None = Field(None, description="results with the same one have the same error")


class FindingView(_Model):
    """Result of a unit."""

    id: str
    uut: str
    quantity: str
    name: str
    at: dict[str, Any] = {}
    value: float
    unit: str
    u: float
    expanded: float = Field(description="expanded uncertainty U")
    low: float | None = None
    high: float | None = None
    u_max: float | None = Field(None, description="largest permitted standard uncertainty")
    monthly_drift: float | None = Field(None, description="specified largest change in a month")
    verdict: str | None = None
    marginal: bool = False
    flags: list[str] = []
    budget: list[SourceView] = []

    @property
    def is_judged(self) -> bool:
        """True if it has a limit."""
        return any(limit is not None for limit in (self.low, self.high, self.u_max))

    @property
    def margin(self) -> float:
        """Distance to the nearer limit in expanded uncertainties, negative outside; infinite without a limit."""
        rooms = [self.value - self.low] if self.low is not None else []
        rooms += [self.high - self.value] if self.high is not None else []
        return min(rooms) / self.expanded if rooms and self.expanded else min(rooms, default=float("inf"))


class UnitVerdict(_Model):
    """Verdict on a unit by one method."""

    place: str
    uut: str
    verdict: str
    flags: list[str] = []


class RunFindings(_Model):
    """Findings of a run; `problem` says why there are none."""

    run: str
    verdict: str | None = None
    reasons: list[str] = Field([], description="why the verdict is not PASS: problems, and results beyond limits")
    problems: list[str] = Field([], description="problems of the run, and what could not be reduced")
    units: list[UnitVerdict] = []
    findings: list[FindingView] = []
    problem: str = ""


def findings_of(run: RunSummary) -> RunFindings:
    """Return the findings of a run; without results, only why there are none."""
    if run.state in ("running", "damaged"):
        return _without_results(run, f"the run is {run.state}")
    try:
        content = read_kept(run.path / RESULTS, _FORM)
    except StoreError as problem:
        there = (run.path / RESULTS).exists()
        why = str(problem) if there else "the run has no results; 'reduce again' computes them from the raw counts"
        return _without_results(run, why)
    found = [_finding(each) for each in content["findings"]]
    units = [
        UnitVerdict(place=each["place"], uut=each["uut"], verdict=each["verdict"], flags=each.get("flags", []))
        for each in content.get("units", [])
    ]
    problems = list(dict.fromkeys([*_problems(run), *map(_left_out, content.get("left_out", []))]))
    return RunFindings(
        run=run.id, verdict=run.manifest.get("verdict") or content["verdict"], units=units, findings=found,
        problems=problems, reasons=[*problems, *_reasons(found)],
    )  # fmt: skip


def _left_out(found: object) -> str:
    match found:
        case {"step": step, "why": why}:
            return f"step {step} was left out: {why}"
    return str(found)


def _problems(run: RunSummary) -> list[str]:
    return [str(each) for each in run.manifest.get("problems", ())]


def _without_results(run: RunSummary, why: str) -> RunFindings:
    problems = _problems(run)
    return RunFindings(
        run=run.id, verdict=run.manifest.get("verdict"), reasons=problems, problems=problems, problem=why
    )


def read_findings(results: Path) -> tuple[list[FindingView], Mapping[str, str]]:
    """Return the findings in a file of results, and the unit in each place. Raises StoreError."""
    content = read_kept(results, _FORM)
    return [_finding(each) for each in content["findings"]], {
        each["place"]: each["uut"] for each in content.get("units", [])
    }


def _reasons(found: list[FindingView]) -> Iterator[str]:
    for each in found:
        if each.verdict == "FAIL":
            side = "low" if each.low is not None and each.value < each.low else "high"
            limit = each.low if side == "low" else each.high
            yield f"{each.uut}: {each.id}: {each.value:.6g} {each.unit} is beyond the limit {limit:.6g} {each.unit}"
        elif each.verdict == INVALID and U_TOO_LARGE in each.flags and each.u_max is not None:
            yield f"{each.uut}: {each.id}: u {each.u:.3g} {each.unit} is above its limit {each.u_max:.3g} {each.unit}"
        elif each.verdict == INVALID:
            yield f"{each.uut}: {each.id} is invalid: {', '.join(each.flags) or 'its uncertainty is not known'}"


def _finding(content: Mapping[str, Any]) -> FindingView:
    limits = content.get("limits") or {}
    known = {key: content[key] for key in ("at", "marginal", "flags", "budget") if key in content}
    return FindingView(
        id=content["id"], uut=content["uut"], quantity=content["quantity"], name=content["name"],
        value=content["value"], unit=content["unit"], u=content["u"], verdict=content["verdict"],
        expanded=content.get("expanded", 2.0 * content["u"]), low=limits.get("min"), high=limits.get("max"),
        u_max=content.get("u_max"), monthly_drift=content.get("monthly_drift"), **known,
    )  # fmt: skip
