"""Sentences of a run: what it does, for how long, and what comes next, in the words of a technician."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from bench.figures.languages import LANGUAGES, language, tr
from bench.figures.sayings import plain
from bench.figures.times_and_sizes import duration
from bench.sequence.plan.dwells import first_visit
from bench.station.runs.live import LiveRun
from bench.web.shown import number, reading

Facts = Mapping[str, Any]
STATES = {
    "running": "Running",
    "paused": "Paused",
    "pauses": "Pauses after this step",
    "asks": "Needs an answer",
    "problem": "Problem",
    "teardown": "Teardown",
    "begins": "Begins",
}
# What a step does, by its verb.
NOW = {
    "move": "Turning {role} to {angle}",
    "orient": "Turning the unit to {attitude}",
    "rotate": "Rotating {role} at {rate}",
    "oscillate": "Oscillating {role} by ± {amplitude}",
    "set on": "Switching {role} on: {level}",
    "set off": "Switching {role} off",
    "ramp": "Changing {role} to {temperature}",
    "soak": "Soaking at {temperature}",
    "wait": "Waiting",
    "wait_until": "Waiting for {reading}",
    "acquire": "Measuring '{label}'",
    "measure": "Measuring {reading}",
    "tare": "Measuring {reading} as zero",
    "prompt": "Waiting for an answer: {text}",
    "note": "Writing a note",
    "alarm": "Raising an alarm",
    "custom": "Step of a plug-in",
}
# What a step will do.
NEXT = {
    "move": "turn {role} to {angle}",
    "orient": "turn the unit to {attitude}",
    "rotate": "rotate {role} at {rate}",
    "oscillate": "oscillate {role} by ± {amplitude}",
    "set on": "switch {role} on: {level}",
    "set off": "switch {role} off",
    "ramp": "change {role} to {temperature}",
    "soak": "soak at {temperature} for at least {least}",
    "wait": "wait {total}",
    "wait_until": "wait for {reading}",
    "acquire": "measure '{label}' for {total}",
    "measure": "measure {reading}",
    "tare": "measure {reading} as zero",
    "prompt": "a question: {text}",
    "note": "a note",
    "alarm": "an alarm",
    "custom": "a step of a plug-in",
}
LEVELS = (("voltage_v", "V"), ("current_a", "A"), ("acceleration_g", "g"))


class Sentence(NamedTuple):
    """State of a run in words. `step` is the id of the step, `number` its place in a plan of `total` steps."""

    state: str
    now: str
    then: str
    step: str
    number: int
    total: int


def sentence_of(live: LiveRun, steady: tuple[float, float] | None = None, since: str = "") -> Sentence:
    """Return what a run does; `steady` are slope per s and range of the reading that a soak waits for.

    `since` is the time of day since when it has stayed within the range that the soak permits; "" if it has not.
    """
    steps: Sequence[Facts] = (live.timeline or {}).get("steps", ())
    places = {step["id"]: place for place, step in enumerate(steps)}
    at = {step: places.get(first_visit(step)) for step in live.state.under_way}
    planned = {step: {} if place is None else steps[place] for step, place in at.items()}
    now = " · ".join(_now(live, step, facts, steady, since) for step, facts in planned.items())
    found = [place for place in at.values() if place is not None]
    last = max(found, default=min(live.state.done, max(0, len(steps) - 1)))
    following = last + 1 if at else last
    then = tr("next: {step}", step=in_words(NEXT, steps[following])) if following < len(steps) else ""
    state = _state(live, [steps[place]["facts"]["phase"] for place in found])
    return Sentence(state, now or _without_step(live, len(steps)), then, ", ".join(at), last + 1, len(steps))


def doing(live: LiveRun) -> dict[str, str]:
    """Return what a run does by languages, without numbers that change meanwhile; empty while its plan is unknown."""
    steps = {step["id"]: step for step in (live.timeline or {}).get("steps", ())}
    planned = [found for step in live.state.under_way if (found := steps.get(first_visit(step))) is not None]
    words: dict[str, str] = {}
    for each in LANGUAGES if steps else ():
        with language(each):
            words[each] = " · ".join(in_words(NOW, step) for step in planned) or _without_step(live, len(steps))
    return words


class Soaking(NamedTuple):
    """Soak in progress that waits for stability: reading, evaluation time in s, permitted range, and its begin.

    The begin is bench time in s, 0 while it is not known.
    """

    reading: str
    over_s: float
    band_c: float
    begun_s: float


def soaking(live: LiveRun) -> Soaking | None:
    """Return the soak in progress that waits for stability, or None."""
    steps = {step["id"]: step["facts"] for step in (live.timeline or {}).get("steps", ())}
    for step in live.state.under_way:
        match steps.get(first_visit(step)):
            case {"verb": "soak", "role": role, "until_stable": {"hold_s": hold_s, "band_c": band_c}}:
                return Soaking(str(role), float(hold_s), float(band_c), _begun_s(live, step) or 0.0)
    return None


def _state(live: LiveRun, phases: Sequence[str]) -> str:
    if live.status.get("questions"):
        return "asks"
    if live.holds:
        return "pauses" if live.state.under_way else "paused"
    if live.state.problems:
        return "problem"
    if "teardown" in phases:
        return "teardown"
    return "running" if live.state.under_way or live.state.done else "begins"


def _without_step(live: LiveRun, total: int) -> str:
    if live.holds:
        return tr("Held before the next step: {by}", by=", ".join(plain(by) for by in live.holds))
    if not live.state.done:
        return tr("Connecting to the instruments")
    return tr("Completes the record and the report") if live.state.done >= total else tr("Between two steps")


def _now(live: LiveRun, step: str, planned: Facts, steady: tuple[float, float] | None, since: str) -> str:
    """Return what a step does, and how far it is."""
    if not planned:
        return tr("order {number}", number=step.rpartition("=")[2]) if "/order=" in step else step
    if live.status.get("manual") and planned["facts"]["verb"] == "custom":
        return tr("Manual control: waits for orders")
    parts = [in_words(NOW, planned), _progress(planned["facts"], _elapsed_s(live, step))]
    match planned["facts"]:
        case {"verb": "soak", "until_stable": stable} if steady is not None:
            parts += [_steadiness(stable, *steady, since)]
        case {"verb": "ramp", "role": role}:
            parts += [_newest(live, f"{role}.process_value")]
        case {"verb": "wait_until", "reading": name}:
            parts += [_newest(live, name)]
    return tr(", ").join(part for part in parts if part)


def in_words(words: Mapping[str, str], planned: Facts) -> str:
    """Return the words of a planned step from `NOW` or `NEXT`."""
    facts = planned["facts"]
    verb = facts["verb"] if facts["verb"] != "set" else f"set {facts['output']}"
    role = facts.get("role", "")
    angle_deg = planned.get("angles_deg", {}).get(role)
    level = next((number(facts[key], unit) for key, unit in LEVELS if facts.get(key) is not None), "?")
    temperature_c = facts.get("temperature_c", planned.get("set_point_c"))
    return tr(
        words[verb], role=tr(role), level=level, label=facts.get("label", ""), reading=facts.get("reading", ""),
        text=facts.get("text", ""), attitude=facts.get("attitude", "?"), temperature=number(temperature_c, "°C"),
        angle=number(facts.get("to_deg") if angle_deg is None else angle_deg, "°"),
        rate=number(facts.get("rate_dps"), "°/s"), amplitude=number(facts.get("amplitude_deg"), "°"),
        least=duration(facts.get("at_least_s") or 0.0), total=duration(planned["duration_s"]),
    )  # fmt: skip


def _progress(facts: Facts, elapsed_s: float | None) -> str:
    """Return the time that has passed in a step that lasts."""
    if elapsed_s is None:
        return ""
    passed = duration(elapsed_s)
    if facts["verb"] == "soak":
        return tr("{passed} of at least {least}", passed=passed, least=duration(facts["at_least_s"]))
    if facts.get("duration_s") is not None:
        return tr("{passed} of {total}", passed=passed, total=duration(facts["duration_s"]))
    return tr("for {passed}", passed=passed) if facts["verb"] in ("wait_until", "acquire", "prompt") else ""


def _steadiness(stable: Facts, slope_per_s: float, spread: float, since: str) -> str:
    """Return slope and range of the reading of a soak beside those that are permitted."""
    slope, most = number(slope_per_s * 3600, form=".1f"), number(stable["slope_c_per_h"])
    band = number(stable["band_c"])
    slope_text = tr("slope {slope} °C/h (needs ≤ {most})", slope=slope, most=most)
    if since:
        return tr(", ").join((tr("within {band} °C since {time}", band=band, time=since), slope_text))
    range_text = tr("range {range} °C (needs ≤ {band})", range=number(spread, form=".2f"), band=band)
    return tr(", ").join((slope_text, range_text))


def _newest(live: LiveRun, name: str) -> str:
    found = live.status.get("readings", {}).get(name)
    return tr("now {value}", value=reading(found)) if found is not None else ""


def _elapsed_s(live: LiveRun, step: str) -> float | None:
    """Return the bench time since a step began; None if that is not known."""
    begun, now_s = _begun_s(live, step), live.status.get("now_s")
    return None if begun is None or now_s is None else max(0.0, float(now_s) - begun)


def _begun_s(live: LiveRun, step: str) -> float | None:
    return next((e.at_s for e in reversed(live.events) if e.step == step and e.kind == "step_begins"), None)
