"""Credit for a soak that a resumed run does again: given for what is proved, and for nothing else."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import bench.engine.crediting as crediting_module
from bench.app.credited import credit_of
from bench.app.resume import Resumption
from bench.config.bench import load_bench
from bench.engine.credit import Chamber, ChamberReading, GuardedPeriod, Instant, NoCredit, Soaked, credit_s, held
from bench.engine.crediting import SoakCredit, SoakEvidence
from bench.engine.past import interrupted_steps, past_of
from bench.engine.soaked import Record, soaked
from bench.figures.after_run import last_states
from bench.quality import Invalid, Stale, Window
from bench.sequence.plan.plan import Branches, Passes, PlannedStep
from bench.sequence.steps.stimulus import Ramp, SetOutput
from bench.sequence.steps.waits import Soak
from bench.store.followed import FOLLOWED, read_lines
from bench.store.reader import Event, Series
from drivers.errors import InstrumentFault
from drivers.values import ChamberState

BOOT, RUN, AT_C, SAFE_C = "b00t", "20260101T000000Z_night_QF-0001", 60.0, 25.0
CHAMBER = Chamber("chamber", "chamber.process_value", "chamber.set_point", 3.0, SAFE_C)
UP_S, UTC_S = (
    5000.0,
    1767225600.0,
)  # since the start of the computer, and since 1970, when the run began at bench time 7
BEGAN_S, SOAK_S, READ_EVERY_S, LAST_READ_S = 7.0, 107.0, 10.0, 197.0
HELD_S = 204.0  # bench time of the first look of the guardian
LOOKS_S = (HELD_S, HELD_S + 30.0, HELD_S + 60.0, HELD_S + 90.0)
HANDED_OVER_S, NOW_S = HELD_S + 100.0, HELD_S + 110.0
FIRST_READ_S = SOAK_S + 3.0
EXPECTED_S = NOW_S - FIRST_READ_S


def instant(at_s: float) -> Instant:
    return Instant(BOOT, UP_S + at_s - BEGAN_S, UTC_S + at_s - BEGAN_S)


def look(
    at_s: float = NOW_S, air_c: float = 60.2, set_point_c: float = AT_C, from_safe_c: float = 35.0
) -> ChamberReading:
    return ChamberReading(instant(at_s), air_c, set_point_c, from_safe_c)


# The record of the run ------------------------------------------------------------------------------------------------


def journal() -> list[tuple[float, str, str, dict[str, Any]]]:
    """(bench time, kind, step, data) of a run that was interrupted in its soak, with its supply switched off before."""
    return [
        (BEGAN_S, "run_begins", "", {"boot": BOOT, "up_s": UP_S}),
        (8.0, "step_begins", "steps/set", {"device": "supply", "output": "on"}),
        (9.0, "step_ended", "steps/set", {"role": "supply", "output": True}),
        (10.0, "step_begins", "steps/set#2", {"device": "supply", "output": "off"}),
        (11.0, "step_ended", "steps/set#2", {"role": "supply", "output": False}),
        (12.0, "step_begins", "steps/move", {"device": "head", "target_deg": 90.0}),
        (13.0, "step_ended", "steps/move", {"device": "head", "angle_deg": 90.0}),
        (14.0, "step_begins", "steps/ramp", {"device": "chamber", "target_c": AT_C, "rate_c_per_min": 1.0}),
        (SOAK_S - 1, "step_ended", "steps/ramp", {"set_point_c": AT_C}),
        (SOAK_S, "step_begins", "steps/soak", {}),
    ]


def readings(*edits: tuple[float, float], value: float = 60.1) -> Series:
    at_s = np.arange(FIRST_READ_S, LAST_READ_S + 1, READ_EVERY_S)
    values = np.full(len(at_s), value)
    for when_s, what in edits:
        values[int((when_s - FIRST_READ_S) // READ_EVERY_S)] = what
    before_s = np.array([50.0, 90.0])  # on the way there
    return Series("chamber.process_value", "°C", np.concatenate([before_s, at_s]), np.concatenate([[30, 50], values]))


def proved(
    *more: tuple[float, str, str, dict[str, Any]],
    entries: list[tuple[float, str, str, dict[str, Any]]] | None = None,
    air: Series | None = None,
    set_point: Series | None = None,
    unknown: frozenset[str] = frozenset(),
) -> Soaked:
    rows = sorted([*(journal() if entries is None else entries), *more], key=lambda each: each[0])
    events = [Event(seq, *row) for seq, row in enumerate(rows, start=1)]
    air, set_point = air or readings(), set_point or readings(value=AT_C)
    return soaked(Record(events, air, set_point, unknown, lambda name: (name,)), "steps/soak", CHAMBER)


def test_a_soak_counts_from_the_first_reading_within_the_band():
    assert proved() == Soaked(
        FIRST_READ_S, instant(FIRST_READ_S).up_s, instant(FIRST_READ_S + 80).up_s, BOOT, AT_C, AT_C
    )
    arriving = readings((FIRST_READ_S, 50.0), (FIRST_READ_S + 10, 56.9))
    assert proved(air=arriving).since_s == FIRST_READ_S + 20.0


def without(step: str, kind: str = "step_ended") -> list[tuple[float, str, str, dict[str, Any]]]:
    return [each for each in journal() if not (each[2] == step and each[1] == kind)]


def begun(boot: object = BOOT, up_s: object = UP_S) -> list[tuple[float, str, str, dict[str, Any]]]:
    return [(BEGAN_S, "run_begins", "", {"boot": boot, "up_s": up_s}), *journal()[1:]]


def gone(series: Series, from_s: float, to_s: float) -> Series:
    kept = (series.at_s <= from_s) | (series.at_s >= to_s)
    return Series(series.name, series.unit, series.at_s[kept], series.values[kept])


RECORDS: dict[str, tuple[Callable[[], Soaked], str]] = {
    "unit under power when it began": (lambda: proved(entries=without("steps/set#2")), "supply was on"),
    "unit not proved to be off": (
        lambda: proved((11.5, "step_begins", "steps/set~2", {"device": "supply", "output": "on"})), "supply was on",
    ),
    "unit under power later": (
        lambda: proved((150.0, "step_begins", "steps/b/set", {"device": "source", "output": "on"})), "source was on",
    ),
    "unit under power for a moment": (
        lambda: proved(
            (150.0, "step_begins", "steps/other/set", {"device": "source", "output": "on"}),
            (152.0, "step_begins", "steps/other/set#2", {"device": "source", "output": "off"}),
            (153.0, "step_ended", "steps/other/set#2", {"role": "source", "output": False}),
        ), "source was on",
    ),
    "several under power": (
        lambda: proved((11.5, "step_begins", "steps/set#3", {"device": "a", "output": "on"}),
                       (11.6, "step_begins", "steps/set#4", {"device": "b", "output": "on"}),
                       (11.8, "step_ended", "steps/set#5", {"outputs": {"a": {"role": "a", "output": False}}})),
        "b was on",
    ),
    "an axis under way": (lambda: proved(entries=without("steps/move")), "moved an axis"),
    "a table that turned": (
        lambda: proved((150.0, "step_begins", "steps/rotate", {"device": "table", "rate_dps": 10.0})), "moved an axis",
    ),
    "a step of a plug-in": (lambda: proved(unknown=frozenset({"steps/move"})), "plug-in"),
    "a step of a plug-in in a loop": (
        lambda: proved((12.5, "step_begins", "steps/while/pass=7/odd~2", {}),
                       unknown=frozenset({"steps/while/pass=1/odd"})), "plug-in",
    ),
    "no ramp": (lambda: proved(entries=without("steps/ramp", "step_begins")), "no ramp"),
    "a ramp under way": (lambda: proved(entries=without("steps/ramp")), "had not ended"),
    "another ramp since": (
        lambda: proved((150.0, "step_begins", "steps/b/ramp", {"device": "chamber", "target_c": 40.0})), "was changed",
    ),
    "interrupted twice": (
        lambda: proved((198.0, "run_resumed", "", {"boot": BOOT, "up_s": UP_S + 191})), "interrupted twice",
    ),
    "never begun": (lambda: proved(entries=without("steps/soak", "step_begins")), "interrupted twice"),
    "no boot": (lambda: proved(entries=begun(boot="")), "which start"),
    "no time since the start": (lambda: proved(entries=begun(up_s=None)), "which start"),
    "that time is no number": (lambda: proved(entries=begun(up_s="5000")), "which start"),
    "clock step": (lambda: proved((150.0, "clock_step", "", {"set_by_s": -3600.0, "slept_s": 0})), "clock was set"),
    "slept before": (lambda: proved((50.0, "clock_step", "", {"set_by_s": 0.0, "slept_s": 20})), "computer slept"),
    "suspended": (lambda: proved((150.0, "stalled", "", {"for_s": 20.0})), "stood still"),
    "on battery": (lambda: proved((150.0, "power", "", {"state": "battery", "text": ""})), "line power"),
    "on battery before": (
        lambda: proved((50.0, "power", "", {"state": "battery", "text": ""})), "line power",
    ),
    "chamber failed": (lambda: proved((190.0, "fault", "", {"device": "chamber", "problem": ""})), "chamber failed"),
    "a doubtful reading": (
        lambda: proved((150.0, "doubted", "", {"reading": "chamber.process_value", "text": ""})), "not valid",
    ),
    "the run had failed": (lambda: proved((190.0, "problem", "", {"text": "the counter is silent"})), "had failed"),
    "air out of band": (lambda: proved(air=readings((FIRST_READ_S + 40, 56.9))), "left the band"),
    "air out of band above": (lambda: proved(air=readings((FIRST_READ_S + 40, 63.1))), "left the band"),
    "air never in band": (lambda: proved(air=readings(value=30.0)), "had not come within"),
    "air not a number": (lambda: proved(air=readings((FIRST_READ_S + 40, np.nan))), "no number"),
    "a gap of 61 s": (lambda: proved(air=gone(readings(), FIRST_READ_S + 10, FIRST_READ_S + 71)), "nobody read"),
    "air not read": (lambda: proved(air=gone(readings(), 100.0, 1e9)), "not read"),
    "set point not read": (lambda: proved(set_point=gone(readings(value=AT_C), 100.0, 1e9)), "not read"),
    "first read late": (lambda: proved(air=gone(readings(), 100.0, SOAK_S + 61)), "nobody read"),
    "times that go back": (
        lambda: proved(air=Series("a", "°C", np.array([110.0, 130.0, 120.0]), np.full(3, AT_C))), "contradict",
    ),
    "set point changed": (
        lambda: proved(set_point=readings((FIRST_READ_S + 40, 59.0), value=AT_C)), "set point was 59 °C",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", RECORDS)
def test_what_the_record_of_the_run_does_not_prove_gives_no_credit(case):
    prove, why = RECORDS[case]
    with pytest.raises(NoCredit, match=why):
        prove()


@pytest.mark.parametrize(
    "entry",
    [
        (50.0, "clock_step", "", {"set_by_s": 1.0, "slept_s": 0}),
        (50.0, "stalled", "", {"for_s": 20.0}),
        (150.0, "power", "", {"state": "line", "text": ""}),
        (150.0, "doubted", "", {"reading": "unit_temperature", "text": ""}),
        (150.0, "fault", "", {"device": "counter", "problem": "silent"}),
        (150.0, "step_begins", "steps/note", {}),
    ],
)
def test_what_does_not_concern_the_chamber_or_was_before_the_soak_takes_nothing_away(entry):
    assert proved(entry) == proved()


def test_a_gap_of_60_s_is_none():
    assert proved(air=gone(readings(), FIRST_READ_S + 10, FIRST_READ_S + 70)) == proved()


def test_of_a_soak_that_was_begun_again_the_last_beginning_counts():
    again = (FIRST_READ_S + 20, "step_begins", "steps/soak~2", {})
    assert proved(again).since_s == FIRST_READ_S + 20


# The record of its guardian -------------------------------------------------------------------------------------------


def lines() -> list[dict[str, Any]]:
    found = [line(at_s, "reading", **temperatures()) for at_s in LOOKS_S]
    found[0]["event"] = "held"
    return [
        line(HELD_S - 1, "commanded", role="supply"),
        *found,
        line(HANDED_OVER_S, "handed_over", why="a run has it"),
    ]


def temperatures() -> dict[str, float]:
    return {"air_c": 60.2, "set_point_c": AT_C, "from_safe_c": 35.0}


def line(at_s: float, event: str, **more: Any) -> dict[str, Any]:
    at = instant(at_s)
    stamp = np.datetime64(round(at.utc_s * 1000), "ms").item().isoformat(timespec="milliseconds") + "+00:00"
    found = {"at": stamp, "boot": BOOT, "up_s": at.up_s, "run": f"/runs/{RUN}", "event": event, "role": "chamber"}
    return {**found, **more}


def text_of(entries: list[dict[str, Any]]) -> str:
    return "".join(json.dumps(each) + "\n" for each in entries)


def credited(folder: Path, text: str | None, now: ChamberReading | None = None) -> float:
    if text is not None:
        (folder / FOLLOWED).write_text(text, "utf-8")
    before = proved()
    meanwhile = held(list(read_lines(folder / FOLLOWED)), RUN, CHAMBER, before)
    return credit_s(before, meanwhile, look() if now is None else now, CHAMBER)


def edited(index: int, **changes: Any) -> str:
    """With a line changed, or without it or one of its keys."""
    found = lines()
    found[index].update(changes)
    found[index] = {key: value for key, value in found[index].items() if value is not None}
    return text_of(found)


def dropped(*indices: int, of: str | None = None) -> str:
    found = (text_of(lines()) if of is None else of).splitlines(keepends=True)
    return "".join(each for index, each in enumerate(found) if index not in indices)


def shifted(from_index: int, by_s: float, *, up: bool = True, day: bool = True) -> str:
    """Lines from one on later or earlier, by one clock or both."""
    found = lines()
    for each, at_s in list(zip(found, (HELD_S - 1, *LOOKS_S, HANDED_OVER_S), strict=True))[from_index:]:
        moved = line(at_s + by_s, "")
        each.update({"up_s": moved["up_s"]} if up else {}, **({"at": moved["at"]} if day else {}))
    return text_of(found)


def inserted(index: int, *entries: dict[str, Any]) -> str:
    found = lines()
    return text_of([*found[:index], *entries, *found[index:]])


def test_a_chamber_that_was_held_until_the_first_look_gives_all_the_time_since_the_soak_began(tmp_path):
    assert credited(tmp_path, text_of(lines())) == pytest.approx(EXPECTED_S)
    assert held(lines(), RUN, CHAMBER, proved()) == GuardedPeriod(4, 30.0, look(LOOKS_S[-1]))


def test_an_earlier_course_that_was_handed_over_too_takes_nothing_away(tmp_path):
    earlier = [line(20.0, "held", **temperatures()), line(30.0, "handed_over", why="a run has it")]
    assert credited(tmp_path, text_of([*earlier, *lines()])) == pytest.approx(EXPECTED_S)


MIDDLE = 3
GUARDIANS: dict[str, tuple[str | None, str]] = {
    "missing file": (None, "no guardian"),
    "empty file": ("", "no guardian"),
    "garbage": ("\x00\xff garbage\n", "damaged"),
    "a garbage line among them": (text_of(lines()[:3]) + "{\n" + text_of(lines()[3:]), "damaged"),
    "a line of another form": (text_of(lines()[:3]) + "[1, 2]\n" + text_of(lines()[3:]), "damaged"),
    "a torn last line": (text_of(lines())[:-40], "damaged"),
    "no role": (edited(MIDDLE, role=None), "damaged"),
    "not held": (dropped(1), "not held"),
    "another chamber": (text_of([{**each, "role": "oven"} for each in lines()]), "not held"),
    "not handed over": (dropped(5), "not handed it over"),
    "only held": (text_of(lines()[:2]), "not handed it over"),
    "the hold has ended": (
        inserted(5, line(LOOKS_S[-1] + 1, "hold_ends", why="its time is over"), line(LOOKS_S[-1] + 2, "commanded")),
        "hold ends, its time is over",
    ),
    "a look that failed": (inserted(2, line(HELD_S + 5, "not_seen", why="no answer")), "not seen, no answer"),
    "looked at after it was handed over": (
        inserted(6, line(HANDED_OVER_S + 1, "reading", **temperatures())), "not handed it over",
    ),
    "a gap of 61 s": (shifted(MIDDLE, 31.0), "nobody read the chamber for 61 s"),
    "a look that is missing": (dropped(MIDDLE, of=shifted(MIDDLE + 1, 0.1)), "nobody read the chamber for 60 s"),
    "first look late": (shifted(1, 61.0), "nobody read"),
    "first look before the last reading": (shifted(1, -30.0), "contradict"),
    "set point changed": (edited(MIDDLE, set_point_c=61.0, from_safe_c=36.0), "set point was 61 °C"),
    "set point changed a little": (edited(MIDDLE, set_point_c=60.2, from_safe_c=35.2), "set point changed from 60"),
    "set point changed before": (
        text_of([{**each, "set_point_c": 60.2, "from_safe_c": 35.2} if "air_c" in each else each for each in lines()]),
        "set point changed from 60",
    ),
    "chamber restarted at its own set point": (edited(MIDDLE, set_point_c=SAFE_C, from_safe_c=0.0), "set point was 25"),
    "chamber restarted and off": (edited(MIDDLE, from_safe_c=0.0), "switched off"),
    "chamber that does not say whether it is off": (edited(MIDDLE, from_safe_c=None), "switched off"),
    "air out of band": (edited(MIDDLE, air_c=63.01), "outside 60 ± 3"),
    "air out of band below": (edited(MIDDLE, air_c=56.99), "outside 60 ± 3"),
    "no air": (edited(MIDDLE, air_c=None), "outside 60 ± 3"),
    "air is no number": (edited(MIDDLE, air_c=float("nan")), "outside 60 ± 3"),
    "air is text": (edited(MIDDLE, air_c="60.2"), "outside 60 ± 3"),
    "air is true": (edited(MIDDLE, air_c=True), "outside 60 ± 3"),
    "air is huge": (edited(MIDDLE, air_c=10**400), "outside 60 ± 3"),
    "no set point": (edited(MIDDLE, set_point_c=None), "set point was nan"),
    "another boot": (text_of([{**each, "boot": "other"} for each in lines()]), "started again"),
    "another boot since": (text_of([*lines()[:5], {**lines()[5], "boot": "other"}]), "started again"),
    "no boot": (edited(MIDDLE, boot=None), "does not state the times"),
    "no time": (edited(MIDDLE, at=None), "damaged"),
    "time without a zone": (edited(MIDDLE, at="2026-01-01T00:04:47"), "does not state the times"),
    "no time since the start": (edited(MIDDLE, up_s=None), "does not state the times"),
    "clock set back": (shifted(MIDDLE, -3600.0, up=False), "clock was set by -3600"),
    "clock set back a little": (shifted(MIDDLE, -2.0, up=False), "clock was set by -2"),
    "clock set forward": (shifted(MIDDLE, 5.0, up=False), r"clock was set by \+5"),
    "edited times": (edited(MIDDLE, at=line(LOOKS_S[2] + 20, "")["at"]), "clock was set by"),
    "edited times since the start": (edited(MIDDLE, up_s=instant(LOOKS_S[2] - 20).up_s), "clock was set by"),
    "times that go back": (text_of([*lines()[:2], lines()[3], lines()[2], *lines()[4:]]), "contradict"),
    "of another run": (edited(MIDDLE, run="/runs/other"), "another run"),
    "of no run": (edited(MIDDLE, run=None), "another run"),
}  # fmt: skip


@pytest.mark.parametrize("case", GUARDIANS)
def test_what_the_guardian_does_not_prove_gives_no_credit(tmp_path, case):
    text, why = GUARDIANS[case]
    with pytest.raises(NoCredit, match=why):
        credited(tmp_path, text)


NOWS: dict[str, tuple[ChamberReading, str]] = {
    "resumed late": (look(LOOKS_S[-1] + 61), "nobody read the chamber for 61 s"),
    "resumed before the last look": (look(LOOKS_S[-1] - 1), "contradict"),
    "another boot": (look()._replace(at=instant(NOW_S)._replace(boot="other")), "started again"),
    "no boot": (look()._replace(at=instant(NOW_S)._replace(boot="")), "started again"),
    "clock set back": (look()._replace(at=instant(NOW_S)._replace(utc_s=UTC_S)), "clock was set by"),
    "set point changed": (look(set_point_c=80.0, from_safe_c=55.0), "set point was 80"),
    "air out of band": (look(air_c=55.0), "outside 60 ± 3"),
    "chamber off": (look(from_safe_c=0.0), "switched off"),
    "not known whether it is off": (look(from_safe_c=float("nan")), "switched off"),
}


@pytest.mark.parametrize("case", NOWS)
def test_what_the_first_look_of_the_resumed_run_does_not_prove_gives_no_credit(tmp_path, case):
    now, why = NOWS[case]
    with pytest.raises(NoCredit, match=why):
        credited(tmp_path, text_of(lines()), now)


def test_a_record_that_is_cut_off_anywhere_gives_no_credit(tmp_path):
    whole = text_of(lines())
    for length in range(len(whole) - 2):
        with pytest.raises(NoCredit):
            credited(tmp_path, whole[:length])


# In the resumed run ---------------------------------------------------------------------------------------------------


class Written:
    """A journal, and a monitor that has seen `window` since the first look."""

    def __init__(self, window: Any = None) -> None:
        self.entries: list[tuple[str, str, dict[str, Any]]] = []
        self._window = window if window is not None else Window(np.array([1.0]), np.array([60.1]))

    def write(self, kind: str, step: str = "", **data: Any) -> None:
        self.entries.append((kind, step, data))

    def window(self, name: str, span_s: float, since_s: float) -> Any:
        assert name == CHAMBER.air
        return self._window


def rig(state: Any) -> Any:
    async def answer() -> ChamberState:
        if isinstance(state, Exception):
            raise state
        return state

    return SimpleNamespace(chamber=lambda role: SimpleNamespace(state=answer))


IN_ORDER = ChamberState(60.2, AT_C, AT_C, 35.0)


def given(
    monkeypatch,
    *,
    at_least: str = "2 h",
    state: Any = IN_ORDER,
    claim: Any = None,
    between: Callable[[SoakCredit], object] = lambda _: None,
    window: Any = None,
    step_id: str = "steps/soak~2",
) -> tuple[float, str, Written]:
    """What a soak gets, the line for a person, and the journal."""
    monkeypatch.setattr(crediting_module, "boot_id", lambda: BOOT)
    monkeypatch.setattr(crediting_module, "since_boot_s", lambda: instant(NOW_S).up_s)
    now = SimpleNamespace(timestamp=lambda: instant(NOW_S).utc_s)
    monkeypatch.setattr(crediting_module, "wall_utc", lambda: now)
    before = proved()
    credit = SoakCredit("steps/soak", claim or SoakEvidence(CHAMBER, before, held(lines(), RUN, CHAMBER, before)))
    written = Written(window)

    async def resumed() -> tuple[float, str]:
        await credit.look(rig(state))
        between(credit)
        return credit.given_s(soak(at_least), step_id, written, written)

    given_s, text = asyncio.run(resumed())
    return given_s, text, written


def soak(at_least: str) -> Soak:
    return Soak.model_validate({"soak": "unit_temperature", "at_least": at_least})


def test_the_decision_and_its_inputs_are_an_entry_of_the_journal(monkeypatch):
    given_s, text, written = given(monkeypatch)
    assert given_s == pytest.approx(EXPECTED_S)
    assert text == (
        "The soak steps/soak~2 is credited with 3.4 of 120 min: chamber was held at 60 °C, its air within 3 °C, "
        "without a gap."
    )
    ((kind, step, data),) = written.entries
    assert (kind, step) == ("soak_credit", "steps/soak~2")
    assert data == {
        "credit_s": EXPECTED_S, "at_least_s": 7200.0, "chamber": "chamber", "set_point_c": AT_C, "band_c": 3.0,
        "since_s": FIRST_READ_S, "looks": 4, "longest_gap_s": 30.0,
    }  # fmt: skip


def test_a_soak_is_never_credited_with_more_than_it_lasts(monkeypatch):
    assert given(monkeypatch, at_least="1 min")[0] == 60.0


def test_another_soak_and_one_without_a_shortest_time_are_not_decided_on(monkeypatch):
    for found in (given(monkeypatch, step_id="steps/other/soak"), given(monkeypatch, at_least="0 s")):
        assert found[0] == 0.0
        assert found[2].entries == []


def test_a_credit_is_used_up_by_the_first_try(monkeypatch):
    _, _, written = given(monkeypatch)
    credit = SoakCredit("steps/soak", "no guardian")
    monitor = Written()
    assert credit.given_s(soak("1 h"), "steps/soak~2", monitor, written)[0] == 0.0
    assert credit.given_s(soak("1 h"), "steps/soak~3", monitor, written) == (0.0, "")
    assert len(written.entries) == 2


def supply_on(credit: SoakCredit) -> None:
    on = {"set": "supply", "voltage": "15 V", "current_limit": "120 mA", "output": "on"}
    credit.begins(SetOutput.model_validate(on))


def ramp(to: str) -> Callable[[SoakCredit], None]:
    return lambda credit: credit.begins(Ramp.model_validate({"ramp": "chamber", "to": to, "at": "1 °C/min"}))


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "a reason before": ({"claim": "chamber was not held"}, "chamber was not held"),
    "something else was on": ({"between": lambda credit: credit.rule_out("supply was found energised")}, "supply was"),
    "the unit is on before it": ({"between": supply_on}, "supply is on before it"),
    "the set point changes before it": ({"between": ramp("20 °C")}, "set point changes before it"),
    "the chamber does not answer": ({"state": TimeoutError()}, "did not answer"),
    "the chamber is not in order": ({"state": InstrumentFault("chamber", "is off")}, "is off"),
    "the chamber is at another set point": ({"state": ChamberState(60.0, 60.0, 80.0, 55.0)}, "set point was 80"),
    "its driver does not say whether it is off": ({"state": ChamberState(60.0, AT_C, AT_C, None)}, "switched off"),
    "the air left the band before it": ({"window": Window(np.array([1.0, 2.0]), np.array([60.0, 63.5]))}, "left 60"),
    "a reading is not valid": ({"window": Invalid(1.0, "jumps by 9 °C", 1, "69")}, "jumps by 9"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_reason_against_it_is_in_the_journal_and_on_the_terminal(monkeypatch, case):
    settings, why = REFUSED[case]
    given_s, text, written = given(monkeypatch, **settings)
    ((kind, _, data),) = written.entries
    assert (given_s, kind, data["credit_s"]) == (0.0, "soak_credit", 0.0)
    assert why in data["why"]
    assert data["why"] in text
    assert "It is done in full." in text


def test_what_is_restored_before_it_takes_nothing_away(monkeypatch):
    assert given(monkeypatch, between=ramp("60 °C"))[0] == pytest.approx(EXPECTED_S)
    off = SetOutput.model_validate({"set": "supply", "output": "off"})
    assert given(monkeypatch, between=lambda credit: credit.begins(off))[0] == pytest.approx(EXPECTED_S)
    not_yet = Stale("has not been read yet", float("inf"))
    assert given(monkeypatch, window=not_yet)[0] == pytest.approx(EXPECTED_S)


def test_a_soak_under_way_is_found_in_branches_and_passes():
    def planned(step_id: str) -> PlannedStep:
        return PlannedStep(step_id, "steps", soak("1 h"), {}, ())

    condition: Any = None
    passes = Passes("steps/while", condition, 5, (planned("steps/while/pass=1/soak"),), ())
    branches = Branches("steps/parallel", {"a": (passes,), "b": (planned("steps/parallel/b/soak"),)}, ())
    rows = [("decided", "steps/while/pass=1", {"taken": True}), ("step_begins", "steps/while/pass=1/soak", {}),
            ("step_ended", "steps/while/pass=1/soak", {}), ("decided", "steps/while/pass=2", {"taken": True}),
            ("step_begins", "steps/while/pass=2/soak", {})]  # fmt: skip
    past = past_of(Event(seq, float(seq), *row) for seq, row in enumerate(rows))
    assert [each.id for each in interrupted_steps((branches,), past)] == ["steps/while/pass=2/soak"]


class Planned(tuple[PlannedStep, ...]):
    """A plan of steps alone."""

    setup: tuple[PlannedStep, ...] = ()

    @property
    def steps(self) -> tuple[PlannedStep, ...]:
        return tuple(self)


@pytest.mark.parametrize(
    ("held_now", "restarted", "chambers", "why"),
    [
        ((), (), 1, "chamber was not held until now"),
        (("chamber",), ("steps/group",), 1, "steps/group is done again from its first step"),
        (("chamber",), (), 0, "does not have one chamber"),
        (("chamber",), (), 2, "does not have one chamber"),
        (("chamber",), (), 1, "there is no such file"),  # there is no record
    ],
)
def test_what_cannot_be_read_or_has_no_held_chamber_gives_no_credit(tmp_path, held_now, restarted, chambers, why):
    file = load_bench(Path(__file__).parents[3] / "config/simulated.yaml").bench
    others = {role: entry for role, entry in file.devices.items() if role != "chamber"}
    devices = {**others, **{f"chamber{number or ''}": file.devices["chamber"] for number in range(chambers)}}
    entries = tuple(Event(seq, *row) for seq, row in enumerate(journal()))
    past = past_of(entries)
    past.restarted = restarted
    plan = Planned([PlannedStep("steps/soak", "steps", soak("1 h"), {}, ())])
    prepared: Any = SimpleNamespace(
        plan=plan, loaded=SimpleNamespace(bench=file.model_copy(update={"devices": devices}))
    )
    credit = credit_of(Resumption(tmp_path / RUN, {}, entries, LAST_READ_S, past), prepared, held_now)
    assert credit is not None
    assert why in credit.given_s(soak("1 h"), "steps/soak~2", Written(), Written())[1]


def test_a_look_that_failed_is_told_of_a_chamber_that_is_held(tmp_path):
    (tmp_path / FOLLOWED).write_text(text_of([line(HELD_S, "not_seen", why="no answer")]), "utf-8")
    assert "held by its guardian; it could not be read at" in last_states(tmp_path)["chamber"]
