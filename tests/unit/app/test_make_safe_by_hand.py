"""`bench make-safe`: which benches, whom it waits for and ends, and what it leaves on record."""

from __future__ import annotations

import json
import signal
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bench import lanes
from bench.app import make_safe as module
from bench.app.arrival import MadeSafe
from bench.app.make_safe import make_safe
from bench.clock import wall_utc
from bench.config.bench import load_bench
from bench.errors import InputError, StoreError
from bench.lanes import Lane, longest_lane_s
from bench.rig import limits_to_make_safe
from bench.runner.held import LOOKS, Kind, address_lock, energising_addresses, owners, real_addresses
from bench.store.energised import energised, note_energised
from bench.store.lockout import lock_out
from bench.store.runs import MANIFEST
from tests.support.guarded import FakeAxis, FakeChamber, FakeSupply, at, bench_file

ROLES = ["chamber", "head", "counter", "supply", "source"]
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


class Made:
    """What a person is told: `notices`, `lanes` and `benches`, in order."""

    def __init__(self) -> None:
        self.notices, self.lanes, self.benches = list[str](), list[Lane](), list[MadeSafe]()

    def __call__(self, name: object = None, **options: Any) -> list[Lane]:
        path = None if name is None else str(name)
        return list(make_safe(path, self.notices.append, self.lanes.append, self.benches.append, **options))


@pytest.fixture(autouse=True)
def state(own_state) -> Path:
    return own_state


@pytest.fixture
def bench(tmp_path) -> Path:
    return bench_file(tmp_path)


@pytest.fixture
def made() -> Made:
    return Made()


@pytest.fixture
def devices(monkeypatch) -> dict[str, Any]:
    """What stands for the instruments, by role."""
    found = {
        "chamber": FakeChamber(at(60.0, 60.0)), "head": FakeAxis("head"), "counter": FakeAxis("counter"),
        "supply": FakeSupply(), "source": FakeSupply("source"),
    }  # fmt: skip
    monkeypatch.setattr(module, "laboratory_of", lambda bench: f"laboratory of {bench.title}")
    monkeypatch.setattr(module, "open_devices", lambda bench, of: found if of == f"laboratory of {bench.title}" else {})
    monkeypatch.setattr(lanes, "STAYS_S", 0.01)
    monkeypatch.setattr(lanes, "CONNECT_S", 0.05)
    return found


@pytest.fixture
def others(monkeypatch) -> list[Any]:
    """Whom the bench is taken over from, and for how long each may end."""
    found: list[Any] = []
    monkeypatch.setattr(module, "take_over", lambda addresses, _notice, end_s: found.append((list(addresses), end_s)))
    return found


def addresses(bench: Path) -> dict[str, str]:
    return {role: str(each) for role, each in real_addresses(load_bench(bench).bench).items()}


def left_on(bench: Path, folder: Path, run_state: str = "completed", *roles: str) -> Path:
    """A run that may have left instruments of a bench on."""
    run = folder / "runs" / "earlier"
    run.mkdir(parents=True)
    (run / MANIFEST).write_text(json.dumps({"state": run_state}), "utf-8")
    note_energised(run, bench, wall_utc(), {role: addresses(bench)[role] for role in roles or ("supply",)})
    return run


def registered() -> Iterator[tuple[str, ...]]:
    return (tuple(each.connections) for each in energised(lambda _: None))


def test_a_bench_that_is_named_is_made_safe(made, bench, devices, others, state, tmp_path):
    left_on(bench, tmp_path, "completed", "supply", "chamber")
    found = made(bench)
    assert [(lane.role, lane.state) for lane in found] == [(role, "safe") for role in ROLES]
    assert sorted(made.lanes) == sorted(found)
    loaded = load_bench(bench).bench
    limits_s = limits_to_make_safe(loaded)
    assert made.notices == [f"{bench}: 5 instruments, at most {longest_lane_s(limits_s):g} s"]
    assert others == [(list(real_addresses(loaded).values()), max(limits_s.values()) + 13)]
    (of_bench,) = made.benches
    assert (of_bench.loaded.document.path, of_bench.safe) == (bench, ("chamber", "head", "supply", "source"))
    assert list(registered()) == []
    (entry,) = map(json.loads, (state / "made_safe.jsonl").read_text("utf-8").splitlines())
    assert entry["bench"] == str(bench)
    assert [lane["role"] for lane in entry["lanes"]] == ROLES
    assert entry["lanes"][0]["air_c"] == 60.0


def test_what_is_not_reached_stays_on_record(made, bench, devices, others, tmp_path):
    left_on(bench, tmp_path, "completed", "supply", "chamber")
    devices["supply"].is_silent = True
    found = made(bench)
    assert {lane.role: lane.state for lane in found}["supply"] == "not reached"
    assert made.benches[0].safe == ("chamber", "head", "source")
    assert list(registered()) == [("supply",)]


def test_its_addresses_are_held_and_signals_ignored_meanwhile(made, bench, devices, others, monkeypatch):
    seen: list[Any] = []
    before = [signal.getsignal(number) for number in SIGNALS]

    async def safe() -> None:
        seen.append(
            {(owner.words, owner.kind) for owner in owners(energising_addresses(load_bench(bench).bench).values())}
        )
        seen.append({signal.getsignal(number) for number in SIGNALS})

    monkeypatch.setattr(devices["head"], "make_safe", safe)
    made(bench)
    assert seen == [{("bench make-safe", Kind.OTHER)}, {signal.SIG_IGN}]
    assert [signal.getsignal(number) for number in SIGNALS] == before


def test_a_lock_does_not_prevent_it(made, bench, devices, others):
    with address_lock(energising_addresses(load_bench(bench).bench).values(), "bench console"):
        found = made(bench)
    assert {lane.state for lane in found} == {"safe"}
    assert "is in use by bench console" in made.notices[-1]
    assert made.notices[-1].endswith("is running. The bench is made safe all the same.")


def test_at_a_bench_that_is_locked_out_it_is_said_and_chambers_stop(made, bench, devices, others):
    lock_out(bench, wall_utc(), "A. Person", "the coil is changed", addresses(bench))
    found = {lane.role: lane.state for lane in made(bench)}
    assert (found["chamber"], found["supply"]) == ("unsafe", "safe")
    assert made.notices[0].startswith("locked out by A. Person since 2")
    assert made.notices[0].endswith(
        ": the coil is changed. Outputs are switched off, everything else is stopped where it is."
    )


def test_it_is_said_that_others_do_not_see_it(made, bench, devices, others, monkeypatch):
    monkeypatch.setattr(module, "problem_to_write", lambda: "this user may not write")
    made(bench)
    assert made.notices[0] == "this user may not write. Other users do not see that this bench is made safe."


def test_a_record_that_cannot_be_written_is_told(made, bench, devices, others, monkeypatch):
    def fails(*_arguments: object) -> None:
        raise StoreError("no disk")

    monkeypatch.setattr(module, "record_made_safe", fails)
    assert {lane.state for lane in made(bench)} == {"safe"}
    assert made.notices[-1] == "no disk"


def test_without_a_name_every_bench_on_record_is_made_safe(made, bench, devices, others, tmp_path):
    run = left_on(bench, tmp_path, "running", "supply", "head")
    assert {lane.state for lane in made()} == {"safe"}
    assert made.notices[0].startswith(f"{run.name}, started 2")
    assert made.notices[0].endswith(": supply, head not known to be safe")
    assert len(made.benches) == 1


def test_without_a_name_and_a_record_it_asks_for_the_name(made):
    with pytest.raises(InputError) as found:
        made()
    words = "no run is on record that may have left instruments on; name the bench: --bench FILE"
    assert str(found.value) == words
    assert made(if_left_on=True) == []


def test_a_bench_file_that_cannot_be_used_is_a_lane(made, bench, tmp_path):
    left_on(bench, tmp_path)
    bench.unlink()
    (lane,) = made()
    assert (lane.role, lane.state, lane.took_s) == (str(bench), "not reached", 0.0)
    assert str(bench) in lane.why
    assert made.lanes == [lane]


@pytest.mark.parametrize("name", [True, False])
def test_if_left_on_it_looks_for_runs_that_are_over(made, bench, devices, others, tmp_path, name):
    left_on(bench, tmp_path)
    assert len(made(bench if name else None, if_left_on=True)) == 5


def test_if_nothing_was_left_on_it_does_nothing(made, bench, devices, tmp_path, monkeypatch):
    run, running = left_on(bench, tmp_path), SimpleNamespace(state="running")
    monkeypatch.setattr(module, "summary", lambda path: running if path == run else None)
    assert made(bench, if_left_on=True) == []
    assert made.notices == [f"{bench}: no run that is over has left an instrument on"]
    assert devices["supply"].calls == []
    assert made(if_left_on=True) == []


def test_one_that_goes_on_hides_no_other(made, bench, devices, others, tmp_path, monkeypatch):
    held = tmp_path / "runs" / "a"
    note_energised(held, bench, wall_utc().replace(year=2020), {"chamber": addresses(bench)["chamber"]})
    running = tmp_path / "runs" / "b"
    note_energised(running, bench, wall_utc().replace(year=2021), {"head": addresses(bench)["head"]})
    left_on(bench, tmp_path)
    states = {running: SimpleNamespace(state="running")}
    monkeypatch.setattr(module, "summary", lambda path: states.get(path, SimpleNamespace(state="completed")))
    chamber = real_addresses(load_bench(bench).bench)["chamber"]
    monkeypatch.setattr(module, "owners", lambda _addresses: set())
    with address_lock([chamber], "the guardian of a", Kind.VISIT, LOOKS):
        assert len(made(if_left_on=True)) == 5
    assert [each.split(",")[0] for each in made.notices[:2]] == ["a: chamber held; its guardian ends that", "earlier"]


def test_what_somebody_has_is_not_left(made, bench, tmp_path):
    left_on(bench, tmp_path)
    with address_lock([real_addresses(load_bench(bench).bench)["supply"]], "a run"):
        assert made(if_left_on=True) == []


def test_a_hold_is_left_to_its_guardian(made, bench, devices, others, tmp_path):
    run = left_on(bench, tmp_path, "completed", "chamber")
    chamber = real_addresses(load_bench(bench).bench)["chamber"]
    with address_lock([chamber], "the guardian of earlier", Kind.VISIT, LOOKS):
        assert made(if_left_on=True) == []
        assert made.notices == [f"{run.name}: chamber held; its guardian ends that"]
        assert len(made()) == 5


def test_one_that_is_held_beside_one_that_is_on_is_not(made, bench, devices, others, tmp_path):
    left_on(bench, tmp_path, "completed", "chamber", "supply")
    chamber = real_addresses(load_bench(bench).bench)["chamber"]
    with address_lock([chamber], "the guardian of earlier", Kind.VISIT, LOOKS):
        assert len(made(if_left_on=True)) == 5


def test_a_guardian_at_work_is_waited_for(made, bench, devices, others, tmp_path, monkeypatch):
    left_on(bench, tmp_path)
    lock = address_lock([real_addresses(load_bench(bench).bench)["supply"]], "the guardian of earlier", Kind.RESCUE)
    lock.__enter__()
    pauses: list[float] = []

    def pause(limit_s: float) -> bool:
        pauses.append(limit_s)
        if len(pauses) == 3:
            lock.__exit__(None, None, None)
        return False

    monkeypatch.setattr(module, "_pause", pause)
    assert len(made(if_left_on=True)) == 5
    assert len(pauses) == 3


def test_one_that_does_not_finish_is_told(made, bench, tmp_path, monkeypatch):
    left_on(bench, tmp_path)
    waited_s: list[float] = []
    monkeypatch.setattr(module, "_pause", lambda limit_s: waited_s.append(limit_s))
    with address_lock([real_addresses(load_bench(bench).bench)["supply"]], "the guardian of earlier", Kind.RESCUE):
        assert made(if_left_on=True) == []
    assert made.notices == ["A guardian has not made a bench safe in time."]
    assert sum(waited_s) == pytest.approx(longest_lane_s({"": 32.0}))


def test_an_entry_with_an_address_that_is_none_is_used_all_the_same(made, bench, devices, others, tmp_path):
    run = tmp_path / "runs" / "earlier"
    note_energised(run, bench, wall_utc(), {"supply": "nonsense"})
    assert len(made()) == 5


def test_a_record_of_another_user_that_cannot_be_read_is_told(made, bench, devices, others, state, tmp_path):
    left_on(bench, tmp_path)
    (state / "energised" / "broken.json").write_text("{", "utf-8")
    made()
    assert any("broken.json" in each for each in made.notices)
