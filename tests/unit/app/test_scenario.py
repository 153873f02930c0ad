"""Scenarios: what may stand in one, what each simulator knows, and faults that end."""

from __future__ import annotations

import json
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from bench.app.laboratory import simulator_of
from bench.app.request import RunRequest, load_bench_named, prepare
from bench.app.scenario import known_faults, with_scenario
from bench.config import simulation
from bench.config.document import read_document
from bench.config.schema import scenario_schema
from bench.errors import InputError
from drivers.description import known_drivers
from simulators.faults.instrument_faults import LINE_FAULTS, FaultKind, FaultPlan, fault_effects_of
from simulators.faults.line_faults import LineFault
from simulators.physics.thermal import DOOR_SHARE, ChamberPhysics, Thermal
from tests.support.laboratory import Laboratory
from tests.support.runs import ROOT

BENCH = str(ROOT / "config/simulated.yaml")
SHIPPED = sorted((ROOT / "config/scenarios").glob("*.yaml"))
HEAD = "schema: itb-scenario/1\ntitle: A test\nfaults:\n"


def problems(tmp_path: Path, *faults: str, bench: str = BENCH, **options: object) -> list[str]:
    path = tmp_path / "s.yaml"
    path.write_text(HEAD + "".join(f"  - {fault}\n" for fault in faults), "utf-8")
    with pytest.raises(InputError) as caught:
        prepare(RunRequest("smoke", bench=bench, scenario=path, **options))  # type: ignore[arg-type]  # of a test
    return [problem.replace(f"{tmp_path}/", "") for problem in caught.value.problems]


@pytest.mark.parametrize(
    ("fault", "problem"),
    [
        ("{device: chamber, fault: stuck}", "4:5: give at, such as 10 min, or after, the id of a step"),
        ("{at: 5, device: chamber, fault: stuck}", "4:6: at: 5 has no unit, write it like '5 s'"),
        ("{at: 5 s, fault: stuck}", "4:5: give either device or unit"),
        ("{at: 5 s, device: chambre, fault: stuck}", "4:15: there is no device 'chambre'; did you mean 'chamber'?"),
        ("{at: 5 s, unit: b, fault: dead}", "4:15: there is no place 'b'; expected a"),
        ("{at: 5 s, unit: a, fault: door_open}", "4:5: fault is 'door_open', a unit can be silent, dead, "),
        ("{at: 5 s, device: head, fault: stuck, for: 0 s}", "4:43: for: "),
        ("{after: steps/none, device: head, fault: stuck}", "4:6: the plan has no step 'steps/none'"),
        (
            "{at: 5 s, device: head, fault: door_open}",
            "4:29: 'head', a simulated aerotech_ensemble, has no fault door_open; it has silent, cut, delay, late, "
            "duplicate, garbage, cut_short, split, flip, echo, half_open, slow_close, frozen, stuck, lag, "
            "emergency_stop, tripped",
        ),
        (
            "{at: 5 s, device: counter, fault: garbage}",
            "4:32: 'counter', a simulated can_counter, has no fault garbage; it has silent, cut, frozen, restart",
        ),
    ],
)
def test_what_is_wrong_is_told_at_its_place(tmp_path, fault, problem):
    (reported,) = problems(tmp_path, fault)
    assert reported.startswith(f"s.yaml:{problem}")


def test_the_same_is_told_of_a_bench_file(tmp_path):
    text = Path(BENCH).read_text("utf-8").replace("seed: 1", "faults: [{device: supply, kind: door_open, at: 5 s}]")
    for file in (*ROOT.glob("config/*.dbc"),):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / "uut").symlink_to(ROOT / "config/uut")
    (tmp_path / "b.yaml").write_text(text.replace("uut/quartz_flexure.yaml", "q.yaml"), "utf-8")
    (tmp_path / "q.yaml").write_bytes((ROOT / "config/uut/quartz_flexure.yaml").read_bytes())
    with pytest.raises(InputError, match=r"b\.yaml:\d+:\d+: 'supply', a simulated scpi_supply, has no fault door_open"):
        prepare(RunRequest("smoke", bench=str(tmp_path / "b.yaml")))


def test_on_real_connections_nothing_is_broken(tmp_path):
    wires = str(ROOT / "config/simulated_wires.yaml")
    reported = problems(tmp_path, "{at: 5 s, device: head, fault: stuck}", bench=wires, units=("Q",))
    assert "this bench has real connections; faults can be injected only into simulators" in reported[0]


def test_instruments_that_are_only_served_have_no_steps(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text(HEAD + "  - {after: steps/move, device: head, fault: stuck}\n", "utf-8")
    served = load_bench_named(str(ROOT / "config/simulated_wires.yaml"))
    with pytest.raises(InputError, match="4:6: after: no sequence runs here; give a time with at instead"):
        with_scenario(served, path, None)
    path.write_text(HEAD + "  - {at: 5 s, device: head, fault: stuck, for: 1 min}\n", "utf-8")
    with_it, document = with_scenario(served, path, None)
    (fault,) = with_it.bench.simulation.faults
    assert document is not None
    assert (fault.device, fault.kind, fault.at, fault.for_) == ("head", "stuck", 5.0, 60.0)
    assert with_scenario(served, None, None) == (served, None)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_scenarios_are_right_by_the_schema_too(path):
    assert list(Draft202012Validator(scenario_schema()).iter_errors(read_document(path).value)) == []
    bad = dict(read_document(path).value, faults=[{"at": "5 s", "device": "head", "fault": "broken"}])
    assert list(Draft202012Validator(scenario_schema()).iter_errors(bad))


def test_the_schema_that_is_shipped_is_the_one_of_the_program():
    shipped = json.loads((ROOT / "docs/schema/scenario.schema.json").read_text("utf-8"))
    assert shipped == scenario_schema()


def test_documents_and_simulators_have_one_list_of_kinds():
    assert set(get_args(simulation.AnyFault)) == set(get_args(FaultKind))
    of_devices = set(get_args(simulation.DeviceFault))
    assert {kind for driver in known_drivers().values() for kind in known_faults(driver)} == of_devices
    assert set(LINE_FAULTS.values()) == set(LineFault) - {LineFault.SILENCE, LineFault.RESET}  # silent, cut


def test_every_simulator_says_what_can_happen_to_it():
    for driver in known_drivers().values():
        simulator = simulator_of(driver)
        assert simulator is None or fault_effects_of(simulator), driver.name


def test_a_fault_is_there_from_its_beginning_to_its_end_and_may_come_again():
    now_s = [0.0]
    plan = FaultPlan({"silent": 10.0}, lambda: now_s[0])
    seen = []
    for at_s in (5.0, 10.0, 12.0, 20.0, 30.0):
        now_s[0] = at_s
        if at_s in (12.0, 30.0):
            plan.end("silent")
        if at_s == 20.0:
            plan.begin("silent")
        seen.append((plan.active("silent"), plan.times("silent")))
    assert seen == [(False, 0), (True, 1), (False, 1), (True, 2), (False, 2)]
    assert plan.spans_s("silent") == [(10.0, 12.0), (20.0, 30.0)]
    plan.end("stuck")  # that was never there
    assert not plan.active("stuck")


def test_frames_of_a_silent_while_are_lost_and_those_around_it_are_not():
    lab = Laboratory()
    counter = lab.counter(faults=FaultPlan(now_s=lambda: lab.host_s))
    lab.host_s = 10.0
    counter.faults.begin("silent")
    lab.host_s = 12.0
    counter.faults.end("silent")
    lab.host_s = 20.0
    at_s = np.unique(counter.take().at_s)
    assert at_s[0] < 1.0
    assert at_s[-1] > 19.0
    (gap,) = np.flatnonzero(np.diff(at_s) > 1.0)
    assert (at_s[gap], at_s[gap + 1]) == (pytest.approx(10.0, abs=0.2), pytest.approx(12.0, abs=0.2))


def test_an_open_door_draws_the_air_to_the_room_and_the_set_point_stays():
    thermal = Thermal(ChamberPhysics(start_c=60.0, limit_cycle_c=0.0), (), 0.0)
    thermal.advance(100.0)
    thermal.door(20.0)
    assert thermal.set_point_c == pytest.approx(60.0)
    thermal.ramp(62.0, 1 / 60)
    thermal.advance(4000.0)
    assert thermal.set_point_c == pytest.approx(62.0)
    assert thermal.air_c == pytest.approx(62.0 - DOOR_SHARE * 40.0, abs=0.1)
    thermal.ramp(63.0, float("inf"))
    thermal.door(None)
    thermal.advance(8000.0)
    assert (thermal.set_point_c, thermal.air_c) == (pytest.approx(63.0), pytest.approx(63.0, abs=0.1))
