"""Words for states, flags, quantities and conditions in a report."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from bench.config.answers import SCRIPTED
from bench.figures.languages import tr
from bench.figures.numbers import scale_shown
from bench.metrology.results.finding import LOWER_BOUND, Finding
from bench.metrology.results.limits import GUARD_BANDS_MEET, IN_GUARD_BAND, U_TOO_LARGE, U_UNKNOWN, Limits
from bench.metrology.unlike_nominal import OTHER_SIGN, OTHER_SIZE
from bench.sequence.method import MethodWords, texts_of
from bench.sequence.steps.talk import DONE

ENDINGS = {
    "completed": "It completed.",
    "error": "It was ended by a problem of the bench; the data measured until then are evaluated here.",
    "failed": "It was ended because a value was outside its limits, as the sequence specifies.",
    "aborted": "It was ended on request before it completed; the data measured until then are evaluated here.",
    "interrupted": (
        "It was interrupted: the program, the computer or its power failed before the run ended. The "
        "data on the disk until then are evaluated here."
    ),
    "running": "It was still going on when this report was written.",
}
QUANTITIES = {
    "K1": "K1 per local g",
    "K1_si": "K1 per m/s²",
    "K2": "K2 + asymmetry",
    "misalignment_y": "misalignment towards Y",
}
_NAMES = MethodWords("NAMES", {})  # parts of a quantity
REASONS = MethodWords(
    "REASONS",
    {
        IN_GUARD_BAND: "inside its limits, but within their guard band",
        GUARD_BANDS_MEET: "its uncertainty is so large that no value could pass the guard band",
        U_UNKNOWN: "its uncertainty is not known, and its limits need it",
        U_TOO_LARGE: "its standard uncertainty is above the limit u_max: a problem of the bench, not of the unit",
        LOWER_BOUND: "it is more than this; the upper end was not measured",
        "not_closed": "the unit or its table changed between the beginning and the end of the run",
        OTHER_SIGN: "its sign is not that of the stated scale factor: the unit is mounted the wrong way round, its "
        "leads are exchanged, or the stated sign is wrong",
        OTHER_SIZE: "it is less than half or more than twice the stated scale factor: see its unit and the unit in the "
        "place",
    },
)
CONDITIONS = MethodWords("CONDITIONS", {})
"""Texts of further conditions of a finding by their keys in `at`; {value} stands for the number."""
# Subjects of sources of uncertainty, besides the names of readings.
SOURCES = (
    "head", "fixture", "counter", "site", "readings", "samples", "bias", "K1", "power cycles", "points",
    "asymmetry of the converter", "scale factor", "temperature", "asymmetry of the voltmeter", "voltmeter", "telemetry",
    "sample",
)  # fmt: skip
CONTENTS = MethodWords(
    "CONTENTS",
    {
        "contains:K2": "contains K2",
        "contains:K3": "contains K3",
        "contains:asymmetry": "contains the asymmetry of converter or voltmeter",
    },
)
SAID = (DONE, SCRIPTED, "rehearsal")  # words of the program among the answers, and among the names of people


def quantity_in_words(quantity: str) -> str:
    """Heading of a quantity in a table: "K1 per m/s²", "K0: temperature coefficient"."""
    return tr(": ").join(tr(part) for part in quantity_text(quantity).split(": "))


def quantity_text(quantity: str) -> str:
    """The same in English."""
    parts = [_NAMES[part] if part in _NAMES else part.replace("_", " ") for part in quantity.split("/")]
    return QUANTITIES.get(quantity, ": ".join(parts))


def name_of(finding: Finding) -> str:
    """Name of a finding without its quantity, which precedes it."""
    name = finding.name.removeprefix(quantity_text(finding.quantity) + ": ")
    return tr(name)


def quantity_of(finding: Finding) -> str:
    """Heading of the quantity of a finding in a table; K2 alone if it does not contain the asymmetry."""
    alone = finding.quantity == "K2" and "contains:asymmetry" not in finding.flags
    return finding.quantity if alone else quantity_in_words(finding.quantity)


def source_in_words(source: str) -> str:
    """Text of a source of uncertainty: "head: zero", "src_1g: source: gain"; names of readings are not translated."""
    what, colon, part = source.partition(": ")
    return (
        f"{tr(what) if what in texts_of('SOURCES', SOURCES) else what}{tr(colon)}{source_in_words(part)}"
        if colon
        else tr(source)
    )


def shared_in_words(shared: str) -> str:
    """Text of an error common to several results: "head.time_base" as "head: time base"."""
    what, point, part = shared.partition(".")
    return source_in_words(f"{what}: {part.replace('_', ' ')}") if point else shared


def answer_text(text: str) -> str:
    """Text of an answer, or of who gave it; text typed by people is unchanged."""
    return tr(text) if text in SAID else text


def end_in_words(end: str) -> str:
    """Text of the end on which a unit stands, "up" or "down"."""
    return tr("+Z up") if end == "up" else tr("+Z down")


def leg_in_words(leg: str) -> str:
    """Text of the direction of a temperature change, "up" or "down"."""
    return tr("rising") if leg == "up" else tr("falling")


def unit_shown(quantity: str, unit: str) -> str:
    """Displayed unit of a quantity; `unit` if it is displayed unchanged."""
    return scale_shown(quantity, unit)[1]


def limits_in_words(quantity: str, unit: str, limits: Limits) -> str:
    """Text of limits in the displayed unit: "-50 to 50", "at most 200", "11300 ± 50"; empty if there are none."""
    factor, _ = scale_shown(quantity, unit)
    low, high = (None if side is None else f"{side * factor:.12g}" for side in (limits.low, limits.high))
    if limits.target is not None and limits.high is not None:
        return f"{limits.target * factor:.12g} ± {(limits.high - limits.target) * factor:.6g}"
    if low is not None and high is not None:
        return tr("{low} to {high}", low=low, high=high)
    if low is not None:
        return tr("at least {low}", low=low)
    return tr("at most {high}", high=high) if high is not None else ""


def bands_in_words(quantity: str, unit: str, limits: Limits) -> str:
    """Text of bands of limits and of the largest u: "guard band 2 u", "marginal within 50", "u at most 20 ppm"."""
    factor, _ = scale_shown(quantity, unit)
    guard = "" if limits.guard_k is None else tr("guard band {k} u", k=f"{limits.guard_k:g}")
    marginal = (
        "" if limits.marginal is None else tr("marginal within {width}", width=f"{limits.marginal * factor:.12g}")
    )
    return tr(", ").join(filter(None, (guard, marginal, u_max_in_words(limits.u_max, limits.u_max_relative, factor))))


def u_max_in_words(u_max: float | None, relative: float | None, factor: float = 1.0) -> str:
    """Text of the largest standard uncertainty, times `factor`; empty without one."""
    if relative is not None:
        return tr("u at most {ratio} ppm of the value", ratio=f"{relative * 1e6:.12g}")
    return "" if u_max is None else tr("u at most {u_max}", u_max=f"{u_max * factor:.12g}")


def _levels_in_words(at: Mapping[str, Any]) -> Iterator[str]:
    """Text of the input level of a finding, and of its reference."""
    if "run" in at:
        yield at["run"]
    if "reference" in at:
        yield tr("against {reference}", reference=at["reference"])
        yield tr(at.get("own_decision", at["decision"]))


def _dwells_in_words(at: Mapping[str, Any], dwells: Mapping[str, int]) -> Iterator[str]:
    """Text of the dwells or the cycle of a finding."""
    if "dwell" in at:
        yield tr("dwell {number}", number=at["dwell"])
    if "dwells" in at:
        numbers = [str(dwells.get(path, path)) for path in at["dwells"]]
        yield tr("dwells {numbers}" if len(numbers) > 1 else "dwell {numbers}", numbers=tr(" and ").join(numbers))
    elif "cycle" in at:
        yield tr("cycle {number}", number=at["cycle"])


def where(at: Mapping[str, Any], dwells: Mapping[str, int]) -> str:
    """Text of the conditions of a finding: "dwell 5, set point 70 °C, rising"; `dwells` are the dwell numbers."""
    parts = [*_levels_in_words(at), *_dwells_in_words(at, dwells)]
    if "axis" in at:
        parts.insert(0, tr("axis {axis}", axis=at["axis"] + at.get("toward", "")))
    if "sensor" in at:
        parts.insert(0, tr(", ").join(filter(None, (at["sensor"], at["mount"]))))
    if at.get("temperature_set_c") is not None:
        parts.append(tr("set point {set_c} °C", set_c=f"{at['temperature_set_c']:g}"))
    elif "temperature_c" in at:
        parts.append(tr("centre {at_c} °C", at_c=f"{at['temperature_c']:.1f}"))
    if "direction" in at:
        parts.append(tr(at["direction"]))
    parts += [text_of(at[key]) for key, text_of in (("end", end_in_words), ("leg", leg_in_words)) if key in at]
    if "at_c" in at:
        parts.append(tr("at {at_c} °C", at_c=f"{at['at_c']:.1f}"))
    parts += [tr(text, value=f"{at[key]:.5g}") for key, text in CONDITIONS.items() if key in at]
    return tr(", ").join(parts)


def of_those_within_u(count: int) -> str:
    """Text of a headline on values whose U reaches over a limit."""
    return tr(
        "{count} value within U of the limit" if count == 1 else "{count} values within U of the limit", count=count
    )
