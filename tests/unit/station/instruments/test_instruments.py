"""Instruments as the station knows them: from bench files and the records of runs, without opening one."""

from __future__ import annotations

from datetime import UTC, date, datetime

import pytest

from bench.config.bench import load_bench
from bench.runner.held import address_lock, real_addresses
from bench.station.instruments.calibrations import all_calibrations, calibrations_of
from bench.station.instruments.view import bench_instruments, limits_of
from bench.store.latch import INCIDENT
from tests.support.runs import ROOT, copy_bench, run_short
from tests.support.web import with_station

NOW = datetime(2030, 12, 1, tzinfo=UTC)
DUE = date(2030, 12, 31)


@pytest.mark.parametrize(
    ("today", "state", "left"),
    [
        (date(2030, 11, 30), "later", 31), (date(2030, 12, 1), "soon", 30), (DUE, "soon", 0),
        (date(2031, 1, 1), "past", -1),
    ],
)  # fmt: skip
def test_a_calibration_is_soon_due_as_the_alerts_have_it(today, state, left):
    from bench.station.alerts.causes import calibrations

    bench = load_bench(ROOT / "config/simulated.yaml").bench
    found = calibrations_of("demo", bench, today, 30)
    assert [(each.name, each.device) for each in found] == [
        ("counter", "counter"), ("head", "head"), ("unit_temperature", "counter"),
    ]  # fmt: skip
    assert {(each.state, each.left_days, each.due) for each in found} == {(state, left, DUE)}
    alerted = calibrations(bench, today, 30)
    assert {each.name for each in found if each.state != "later"} == alerted.keys()


def test_calibrations_of_all_benches_are_in_the_order_of_their_dates(tmp_path):
    first = copy_bench(tmp_path / "one", ("date: 2026-01-01, due: 2030-12-31", "date: 2026-01-01, due: 2030-06-30"))

    async def act(here):
        benches = {"demo": here.daemon.settings.benches["demo"], "other": first, "gone": tmp_path / "gone.yaml"}
        here.daemon.scheduler._settings = here.daemon.settings = here.daemon.settings._replace(benches=benches)
        found = all_calibrations(here.daemon, NOW)
        assert [each.due for each in found] == sorted(each.due for each in found)
        assert {each.bench for each in found} == {"demo", "other"}
        assert (found[0].bench, found[0].state) == ("other", "past")
        gone = bench_instruments(here.daemon, "gone", NOW)
        assert (gone.instruments, "gone.yaml" in gone.problem) == ([], True)

    with_station(tmp_path / "here", act)


def test_limits_have_the_units_of_the_bench_file():
    devices = load_bench(ROOT / "config/simulated.yaml").bench.devices
    assert [tuple(each.model_dump().values()) for each in limits_of(devices["chamber"])] == [
        ("temperature", -50.0, 100.0, "°C"), ("ramp_rate", None, 3.0, "°C/min"),
    ]  # fmt: skip
    assert {each.name: each.unit for each in limits_of(devices["head"])} == {"angle": "°", "rate": "°/s"}
    assert {each.name: each.unit for each in limits_of(devices["supply"])} == {"voltage": "V", "current": "A"}


def test_identity_errors_and_latches_are_those_of_the_last_runs(tmp_path):
    bench = copy_bench(tmp_path / "bench", faults="[{device: head, kind: silent, at: 20 s}]")
    ran = run_short(tmp_path / "runs", bench=bench, sequence="smoke")
    (ran.path / INCIDENT).write_text('{"event": "begins", "why": "the run hung"}\n')

    async def act(here):
        here.daemon.scheduler._settings = here.daemon.settings = here.daemon.settings._replace(benches={"demo": bench})
        here.daemon.catalogue.runs = tmp_path / "runs"
        found = bench_instruments(here.daemon, "demo", NOW)
        assert found.latches[0].run == ran.path.name
        assert "the run hung" in found.latches[0].why
        head = next(each for each in found.instruments if each.role == "head")
        assert (head.serial, head.identified_by) == ("SIM-HEAD-01", ran.path.name)
        assert head.faults
        assert all(each.run == ran.path.name for each in head.faults)
        assert next(each for each in found.instruments if each.role == "supply").faults == []
        assert found.guardian == "not needed"

    with_station(tmp_path / "here", act)


def test_who_holds_a_real_instrument_is_named_and_nothing_is_opened(tmp_path):
    path = ROOT / "config/simulated_wires.yaml"
    bench = load_bench(path).bench

    async def act(here):
        here.daemon.scheduler._settings = here.daemon.settings = here.daemon.settings._replace(benches={"demo": path})
        free = bench_instruments(here.daemon, "demo", NOW)
        assert (free.guardian, {each.held_by for each in free.instruments}) == ("none", {""})
        with address_lock([real_addresses(bench)["head"]], "a console of head"):
            held = {each.role: each.held_by for each in bench_instruments(here.daemon, "demo", NOW).instruments}
        assert "a console of head" in held["head"]
        assert held["chamber"] == ""

    with_station(tmp_path, act)
