"""Manual control in virtual time: orders obeyed inside limits and interlocks, on record, and ended by silence."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from pydantic import TypeAdapter

from bench.config.interlocks import InterlockEntry
from bench.config.models import BenchFile
from bench.engine.engine import Engine
from bench.errors import InputError
from drivers.errors import DriverError
from tests.support.engines import Ran, Script, run_plan
from tests.support.sequences import BENCH, ROOT, load_plan

ON = "{set: supply, voltage: 15 V, current_limit: 120 mA, output: on}"
OFF = "{set: supply, output: off}"


def session(folder: Path, script: Script, *settings: str, bench: BenchFile = BENCH) -> Ran:
    """A session of manual control, and what became of it; it ends when the script does."""

    async def controlled(engine: Engine) -> None:
        while engine.manual.to_json() is None:  # noqa: ASYNC110  in virtual time
            await asyncio.sleep(0.1)
        await script(engine)
        if engine.manual.to_json() is not None:
            engine.manual.finish()

    plan = load_plan(ROOT / "sequences/manual.yaml", bench, settings=settings)
    return run_plan(folder / "run", plan, bench, controlled)


async def until_done(engine: Engine, order: str) -> None:
    """Wait for the end of an order, with signs of life."""
    while order in (engine.manual.to_json() or {"busy": {}})["busy"]:
        engine.manual.heard()
        await asyncio.sleep(1.0)


def test_orders_are_obeyed_like_steps_and_journalled_with_who_gave_them(tmp_path):
    async def script(engine: Engine) -> None:
        ramp = engine.manual.order("{ramp: chamber, to: 22 °C, at: 2 °C/min}", "anna")  # while the others go on
        for order in (ON, "{move: head, to: 90 °}", "{move: head, by: -30 °}", "{measure: head.angle}", OFF):
            await until_done(engine, engine.manual.order(order, "anna"))
        await until_done(engine, ramp)

    ran = session(tmp_path, script)
    assert (ran.outcome.how, ran.made_safe, ran.moving, ran.powered) == ("completed", {}, False, False)
    assert [(each.step, each.data["by"], each.data["order"][:6]) for each in ran.events_of("order")] == [
        ("steps/order=1", "anna", "{ramp:"), ("steps/order=2", "anna", "{set: "), ("steps/order=3", "anna", "{move:"),
        ("steps/order=4", "anna", "{move:"), ("steps/order=5", "anna", "{measu"), ("steps/order=6", "anna", "{set: "),
    ]  # fmt: skip
    assert ran.steps()[:5] == [f"steps/order={number}" for number in (2, 3, 4, 5, 6)]
    assert set(ran.steps()) == {"steps/custom", *(f"steps/order={number}" for number in range(1, 7))}
    assert ran.ended("steps/order=2").data["output"] is True
    assert ran.begun("steps/order=4").data["target_deg"] == 60.0
    assert ran.ended("steps/order=5").data["value"] == pytest.approx(60.0, abs=0.01)
    assert ran.ended("steps/order=1").at_s > ran.ended("steps/order=6").at_s


@pytest.mark.parametrize(
    ("order", "problem"),
    [
        ("{move: head, to: 400 °}", "400 ° is above the 365 ° that the bench file allows 'head'. Nothing was sent."),
        ("{ramp: chamber, to: 120 °C, at: 1 °C/min}", "120 °C is above the 100 °C"),
        ("{ramp: chamber, to: 20 °C, at: 9 °C/min}", "9 °C/min is above the 3 °C/min"),
        ("{set: supply, voltage: 48 V, current_limit: 1 A, output: on}", "48 V is above the 16 V"),
        ("{move: head, to: 90}", "90 has no unit"),
        ("{move: head, to: nan °}", "nan"),
        ("{move: chamber, to: 90 °}", "'chamber' is a thermal_chamber"),
        ("{move: nothing, to: 90 °}", "'nothing' is not among the needs"),
        ("{move: head, to: '${1 °}'}", "no expressions"),
        ("{move: head, to: 90 °, timeout: 1 s}", "'timeout' is no key of an order 'move'"),
        ("{acquire: counter, for: 10 s, label: a}", "'acquire' is no order"),
        ("{rotate: head, at: 1 °/s, for: 10 s}", "needs a rate_table"),
        ("[move, head]", "one step of a sequence"),
        ("{move: head", "order:"),
        ("", "one step of a sequence"),
    ],
)  # fmt: skip
def test_an_order_beyond_limits_or_of_another_form_is_refused_and_nothing_is_sent(tmp_path, order, problem):
    refused: list[str] = []

    async def script(engine: Engine) -> None:
        with pytest.raises(InputError) as caught:
            engine.manual.order(order, "anna")
        refused.append(str(caught.value))

    ran = session(tmp_path, script)
    assert problem in refused[0]
    (entry,) = ran.events_of("order_refused")
    assert (entry.data["by"], entry.data["order"], entry.data["text"]) == ("anna", order, refused[0])
    assert (ran.events_of("order"), ran.steps("step_begins")) == ([], ["steps/custom"])


def test_silence_of_the_controlling_person_is_a_stop(tmp_path):
    async def script(engine: Engine) -> None:
        engine.manual.order(ON, "anna")
        for _ in range(10):
            await asyncio.sleep(100.0)
            engine.manual.heard()
        await asyncio.sleep(10_000.0)

    ran = session(tmp_path, script, "silence=2 min")
    assert (ran.outcome.how, ran.made_safe, ran.powered) == ("aborted", {}, False)
    assert ran.outcome.ended_by is not None
    assert ran.outcome.ended_by.by == "silence"
    (end,) = ran.events_of("end_requested")
    assert (end.data["action"], end.data["text"]) == ("stop", "nobody has given a sign of life for 2 min")
    assert end.at_s == pytest.approx(1000 + 120, abs=5)


def test_halt_stops_a_motion_at_once_and_the_session_goes_on(tmp_path):
    async def script(engine: Engine) -> None:
        engine.manual.order("{move: head, to: 350 °}", "anna")
        await asyncio.sleep(3.0)
        with pytest.raises(InputError, match="head still executes steps/order=1; halt it"):
            engine.manual.order("{move: head, to: 10 °}", "anna")
        assert engine.manual.halt("head") == "steps/order=1"
        await until_done(engine, "steps/order=1")
        with pytest.raises(InputError, match="no order to 'head' is under way"):
            engine.manual.halt("head")
        engine.manual.order("{move: head, to: 10 °}", "anna")
        engine.manual.halt("head")  # before it has begun
        await until_done(engine, "steps/order=2")
        await until_done(engine, engine.manual.order("{measure: head.angle}", "anna"))

    ran = session(tmp_path, script)
    assert (ran.outcome.how, ran.steps("step_cut")) == ("completed", ["steps/order=1"])
    assert 20 < ran.ended("steps/order=3").data["value"] < 100
    assert "steps/order=2" not in ran.steps("step_begins")


def test_the_end_of_a_session_interrupts_what_is_under_way(tmp_path):
    async def script(engine: Engine) -> None:
        engine.manual.order("{ramp: chamber, to: 80 °C, at: 1 °C/min}", "anna")
        await asyncio.sleep(60.0)

    ran = session(tmp_path, script)
    assert (ran.outcome.how, ran.made_safe) == ("completed", {})
    assert ran.steps("step_cut") == ["steps/order=1"]


@pytest.mark.parametrize(("then", "how"), [("pause", "completed"), ("stop", "error")])
def test_interlocks_hold_and_end_a_session_and_switching_off_stays_possible(tmp_path, then, how):
    entry = TypeAdapter(InterlockEntry).validate_python({"reading": "supply.current", "above": "1 mA", "then": then})
    bench = BENCH.model_copy(update={"interlocks": {"on": entry}})

    async def script(engine: Engine) -> None:
        await until_done(engine, engine.manual.order(ON, "anna"))
        await asyncio.sleep(30.0)
        if then == "pause":
            with pytest.raises(InputError, match="held by interlock on; until then only switching off"):
                engine.manual.order("{move: head, to: 90 °}", "anna")
            await until_done(engine, engine.manual.order(OFF, "anna"))
            await asyncio.sleep(30.0)
            await until_done(engine, engine.manual.order("{move: head, to: 5 °}", "anna"))

    ran = session(tmp_path, script, bench=bench)
    assert (ran.outcome.how, ran.made_safe, ran.powered) == (how, {}, False)
    assert [each.data["tripped"] for each in ran.events_of("interlock")] == [True, False][: 2 if then == "pause" else 1]


def test_a_failed_order_leaves_its_device_safe_and_the_session_goes_on(tmp_path):
    async def script(engine: Engine) -> None:
        await until_done(engine, engine.manual.order(ON, "anna"))
        supply = engine._rig.devices["supply"]
        read = supply.read

        async def fails():
            supply.read = read
            raise DriverError("supply", "does not answer as expected")

        supply.read = fails
        await until_done(engine, engine.manual.order(ON, "anna"))
        await until_done(engine, engine.manual.order("{move: head, to: 5 °}", "anna"))

    ran = session(tmp_path, script)
    assert (ran.outcome.how, ran.steps("step_failed")) == ("completed", ["steps/order=2"])
    assert [each.data["device"] for each in ran.events_of("order_made_safe")] == ["supply"]
    assert "steps/order=3" in ran.steps()
