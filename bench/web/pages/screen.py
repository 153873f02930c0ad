"""Screen of a bench: everything that its page shows of a run in progress, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from bench.clock import wall_utc
from bench.engine.control import OPERATOR
from bench.figures.languages import tr
from bench.figures.sayings import plain
from bench.figures.times_and_sizes import duration
from bench.station.runs.live import LiveRun
from bench.station.view import ItemView, item_views
from bench.store.tail import instant_at
from bench.web.news import Line, news
from bench.web.pages.drawn import Timeline, timeline
from bench.web.pages.outlook import Guarded, ends, guard_of, since
from bench.web.pages.panels import panels_of
from bench.web.pages.readings import Row, rows
from bench.web.pages.trends import Trend
from bench.web.sentence import STATES, Sentence, sentence_of
from bench.web.services import Services

NEWS_SHOWN = 6


class Ending(NamedTuple):
    """What ending a run does, in words: after its step, at once, or without a teardown."""

    after_step: str
    now: str
    abort: str


class Screen(NamedTuple):
    """A run in progress as it is shown. `ends_why` says what its end is from; `panels` are the curves as JSON."""

    bench: str
    run: str
    title: str
    units: str
    operator: str
    state: str
    state_text: str
    sentence: Sentence
    ends: str
    ends_why: str
    speed: str
    timeline: Timeline | None
    rows: list[Row]
    news: list[Line]
    problems: list[str]
    held_by: list[str]
    interlocks: list[str]
    questions: list[Mapping[str, Any]]
    safe: list[str]
    guard: Guarded
    ending: Ending
    panels: str
    zone: str


def screen_of(live: LiveRun, bench: str, zone: str, trend: Trend) -> Screen:
    """Return the screen of a run in the current language."""
    sentence, now = sentence_of(live, trend.steady, since(live, trend, zone)), wall_utc()
    manifest, plan = live.run.manifest, live.timeline or {}
    steps = plan.get("steps", ())
    planned = steps[sentence.number - 1] if steps else {}
    return Screen(
        bench, live.run.id, tr(str(manifest.get("title", ""))), " · ".join(live.run.units),
        str(manifest.get("operator", "")), sentence.state, tr(STATES[sentence.state]), sentence,
        *ends(live, zone, now),
        tr("simulated, {speed} times as fast", speed=f"{live.speed:.0f}") if live.speed > 1.5 else "",
        timeline(plan, sentence.number - 1, _in_step_s(live, sentence.step)), rows(live, planned, trend),
        news(reversed(live.events), instant_at(live.begun, 0.0), {step["id"]: step for step in steps}, NEWS_SHOWN),
        list(live.state.problems), live.holds, [plain(by) for by in live.holds if by != OPERATOR],
        list(live.status.get("questions", ())), _safe(plan), guard_of(live.status, plan),
        _ending(live, plan, planned), panels_of(live, trend), zone,
    )  # fmt: skip


def live_of(services: Services, bench: str) -> LiveRun | None:
    """Return the run in progress at a bench, or None. Raises InputError for a bench that the station does not have."""
    services.daemon.settings.bench_file(bench)
    return services.daemon.live_at(bench)


def waiting_at(services: Services, bench: str) -> list[ItemView]:
    """Return the items that wait for a bench."""
    daemon = services.daemon
    return item_views(daemon, [each for each in daemon.queue.waiting() if each.submission.bench == bench])


def _in_step_s(live: LiveRun, step: str) -> float:
    begun = next((e.at_s for e in reversed(live.events) if step and e.step == step), None)
    now_s = live.status.get("now_s")
    return max(0.0, float(now_s) - begun) if begun is not None and now_s is not None else 0.0


def _safe(plan: Mapping[str, Any]) -> list[str]:
    """Return the safe state of each device that moves or energises something."""
    found = []
    for role, each in plan.get("made_safe", {}).items():
        alone = each.get("alone_after_s")
        text = f"{tr(role)}: {tr(each['state'])}"
        found.append(f"{text}; {tr('by itself after {time}', time=duration(alone))}" if alone is not None else text)
    return found


def _ending(live: LiveRun, plan: Mapping[str, Any], planned: Mapping[str, Any]) -> Ending:
    """Return what the ways to end a run do, before anybody presses them."""
    speed = max(live.speed, 1e-3)
    teardown = duration(plan.get("phases_s", {}).get("teardown", 0.0) / speed)
    left_s = max(0.0, float(planned.get("duration_s", 0.0)) - _in_step_s(live, ", ".join(live.state.under_way))) / speed
    within = max((float(each["within_s"]) for each in plan.get("made_safe", {}).values()), default=0.0)
    if not plan.get("steps"):
        unknown = tr("The plan is being read.")
        return Ending(unknown, unknown, tr("Drops everything, without a teardown; all devices are made safe."))
    states = tr("; ").join(f"{tr(role)} {tr(each['state'])}" for role, each in plan.get("made_safe", {}).items())
    return Ending(
        tr(
            "Finishes this step (at most about {left}), then about {teardown} of teardown.",
            left=duration(left_s),
            teardown=teardown,
        ),
        tr("Interrupts this step now, then about {teardown} of teardown.", teardown=teardown),
        tr("Drops everything, without a teardown. Within {within}: {states}.", within=duration(within), states=states),
    )
