"""A guardian makes the bench of a run that has died safe, tells it, and follows the chambers."""

from __future__ import annotations

import hashlib
import os
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from bench import lanes
from bench.clock import wall_utc
from bench.errors import InputError
from bench.guardian import rescue as module
from bench.guardian.follow import guardian_of
from bench.guardian.rescue import Rescue
from bench.guardian.watch import Lost, Over
from bench.runner.held import Kind, Owner, address_lock, energising_addresses, owners, real_addresses
from bench.store.energised import energised, note_energised
from bench.store.lockout import lock_out
from bench.store.unsafe import FOLDER, read_unsafe
from drivers.transport.wires import RealWires
from tests.support.guarded import FakeAxis, FakeChamber, FakeSupply, at

ROLES = ["chamber", "head", "supply", "source"]
DIED = Lost("the process of the run has died")


class Followed:
    """A supervision that only tells whose it is."""

    made: list[Followed]
    problem: Exception | None = None

    def __init__(self, by: object, bench: object, safe: object, held: object) -> None:
        if self.problem is not None:
            raise self.problem
        self.made.append(self)
        self.of, self.did = (by, bench, safe, held), list[str]()

    def __enter__(self) -> Followed:
        self.did.append("entered")
        return self

    def __exit__(self, *_exc: object) -> None:
        self.did.append("left")

    def follow(self) -> None:
        self.did.append("followed")


@pytest.fixture
def devices(monkeypatch) -> dict[str, Any]:
    """What stands for the instruments, by role."""
    found = {
        "chamber": FakeChamber(at(60.0, 60.0)), "head": FakeAxis("head"), "supply": FakeSupply(),
        "source": FakeSupply("source"),
    }  # fmt: skip

    def device_of(role: str, entry: Any, wires: object) -> Any:
        assert (str(entry.connection), type(wires)) == (str(found["addresses"][role]), RealWires)
        return found[role]

    monkeypatch.setattr(module, "device_of", device_of)
    monkeypatch.setattr(lanes, "STAYS_S", 0.01)
    monkeypatch.setattr(lanes, "CONNECT_S", 0.05)
    monkeypatch.setattr(module, "_pause", lambda _s: None)
    return found


@pytest.fixture
def made(monkeypatch) -> list[Followed]:
    """The supervisions that were begun."""
    found: list[Followed] = []

    class Noting(Followed):
        made = found

    monkeypatch.setattr(module, "Following", Noting)
    monkeypatch.setattr(module, "end_on_sigterm", lambda each: each.did.append("ends on SIGTERM"))
    monkeypatch.setattr(module, "redirect_to_null", lambda: found[-1].did.append("quiet"))
    return found


@pytest.fixture
def loaded(run, bench, tmp_path, devices, made) -> Rescue:
    """A guardian of the run, whose process is 7."""
    devices["addresses"] = energising_addresses(bench)
    path = tmp_path / "config" / "simulated.yaml"
    note_energised(run, path, wall_utc(), {role: str(each) for role, each in energising_addresses(bench).items()})
    return Rescue(run, path, hashlib.sha256(path.read_bytes()).hexdigest(), 7)


def left_on() -> list[str]:
    return [role for each in energised(lambda _: None) for role in each.connections]


def test_a_bench_file_that_has_changed_is_not_used(run, bench, tmp_path):
    path = tmp_path / "config" / "simulated.yaml"
    with pytest.raises(InputError) as found:
        Rescue(run, path, "0" * 64, 7)
    assert str(found.value) == f"{path}: has changed since the run has read it"


def test_each_instrument_may_be_as_long_without_a_poll_as_its_driver_and_the_bench_allow(loaded, bench):
    busy_s = {role: bench.devices[role].busy_s for role in ROLES}
    assert {role: loaded.polls_within_s[role] - busy_s[role] for role in ROLES} == pytest.approx(
        dict.fromkeys(ROLES, 10.0)
    )


def test_an_instrument_with_a_named_reading_is_polled_more_often(run, bench, tmp_path, devices, made):
    path = tmp_path / "config" / "simulated.yaml"
    air = "readings:\n  air: {from: chamber.process_value, limits: {min: -55 °C, max: 105 °C}, stale_after: 5 s}\n"
    path.write_text(path.read_text("utf-8").replace("readings:\n", air), "utf-8")
    devices["addresses"] = energising_addresses(bench)
    found = Rescue(run, path, hashlib.sha256(path.read_bytes()).hexdigest(), 7).polls_within_s
    assert found["chamber"] - bench.devices["chamber"].busy_s == pytest.approx(1.0)
    assert found["head"] - bench.devices["head"].busy_s == pytest.approx(10.0)


def test_every_instrument_is_made_safe_and_it_is_told(loaded, devices, entries, capfd, told):
    assert loaded.make_safe(DIED) is True
    for role in ROLES:
        assert devices[role].calls[:3] == ["enter", "identify", "make_safe"], role
        assert devices[role].calls[-1] == "exit", role
    begins, *between, ends = entries("incident.jsonl")
    assert begins == {"event": "begins", "why": DIED.why}
    assert ends == {"event": "ends", "unsafe": {}}
    assert [(each["event"], each["role"], each["state"], each["why"]) for each in between] == [
        ("lane", role, "safe", "") for role in ROLES
    ]
    assert between[0]["air_c"] == 60.0
    lines = capfd.readouterr().err.splitlines()
    assert lines[0] == f"a run: {DIED.why}. Its guardian makes the bench safe: chamber, head, supply, source."
    assert sorted(lines[1:-1]) == [f"a run: {role} safe" for role in sorted(ROLES)]
    assert lines[-1] == "a run: the bench is safe."
    assert told() == f"a run: ended by its guardian\na run: ended by its guardian\n{DIED.why}\n"
    assert left_on() == []


def test_then_the_chambers_are_followed_in_silence(loaded, bench, run, made, told):
    loaded.make_safe(DIED)
    (following,) = made
    by, found, safe, held = following.of
    assert (by, found.title, safe, held) == (guardian_of(run, 7), bench.title, ROLES, [])
    assert following.did == ["ends on SIGTERM", "entered", "quiet", "followed", "left"]


def test_the_addresses_are_held_meanwhile(loaded, devices, bench, monkeypatch):
    found: list[Owner] = []

    async def make_safe() -> None:
        found.extend(owners(energising_addresses(bench).values()))

    monkeypatch.setattr(devices["head"], "make_safe", make_safe)
    loaded.make_safe(DIED)
    (owner,) = found
    assert (owner.process, owner.words, owner.kind) == (os.getpid(), "the guardian of a run", Kind.RESCUE)
    assert owners(energising_addresses(bench).values()) == set()


def test_one_that_is_not_reached_is_named_everywhere(loaded, devices, entries, capfd, told, run, bench, made, state):
    devices["supply"].is_silent = True
    assert loaded.make_safe(DIED) is False
    why = "supply: does not answer"
    lane = next(each for each in entries("incident.jsonl") if each.get("role") == "supply")
    assert (lane["state"], lane["why"]) == ("not reached", why)
    assert entries("incident.jsonl")[-1] == {"event": "ends", "unsafe": {"supply": why}}
    lines = capfd.readouterr().err.splitlines()
    assert f"a run: supply not reached {why}" in lines
    assert lines[-1] == "a run: NOT MADE SAFE: supply. Try 'bench make-safe'."
    assert told().startswith("a run: NOT MADE SAFE: supply\n")
    assert read_unsafe(run) == {"supply": why}
    (record,) = (state / FOLDER).iterdir()
    assert f'"connection": "{energising_addresses(bench)["supply"]}"' in record.read_text("utf-8")
    assert left_on() == ["supply"]
    assert made[0].of[2] == ["chamber", "head", "source"]


def test_two_that_are_not_are_both_named(loaded, devices, told, capfd):
    devices["supply"].is_silent = devices["head"].is_silent = True
    loaded.make_safe(DIED)
    assert capfd.readouterr().err.endswith("a run: NOT MADE SAFE: head, supply. Try 'bench make-safe'.\n")
    assert told().startswith("a run: NOT MADE SAFE: head, supply\n")


def test_a_chamber_is_held_where_the_run_allows_it(loaded, devices, made, entries):
    assert loaded.make_safe(Lost("it died", may_hold=True)) is True
    assert devices["chamber"].calls == ["enter", "identify", "state", "hold", "state", "exit"]
    assert made[0].of[2:] == (["head", "supply", "source"], ["chamber"])
    assert entries("incident.jsonl")[1]["state"] == "held"
    assert left_on() == ["chamber"]


def test_at_a_bench_that_is_locked_out_the_chamber_only_stops(loaded, devices, bench, tmp_path):
    connections = {role: str(each) for role, each in real_addresses(bench).items()}
    lock_out(tmp_path / "bench.yaml", wall_utc(), "A. Person", "the coil is changed", connections)
    assert loaded.make_safe(DIED) is False
    assert "make_safe" not in devices["chamber"].calls
    assert devices["supply"].output is False


def test_the_locks_of_the_dead_run_are_waited_for(loaded, bench, monkeypatch):
    held = address_lock(energising_addresses(bench).values(), "the run", Kind.RUN)
    held.__enter__()
    pauses: list[float] = []

    def pause(limit_s: float) -> None:
        pauses.append(limit_s)
        if len(pauses) == module.ATTEMPTS - 1:
            held.__exit__(None, None, None)

    monkeypatch.setattr(module, "_pause", pause)
    assert loaded.make_safe(DIED) is True
    assert pauses == [module.BETWEEN_ATTEMPTS_S] * (module.ATTEMPTS - 1)


def test_a_bench_that_another_program_keeps_is_told_as_not_safe(loaded, devices, bench, entries, told, run, made):
    with address_lock(energising_addresses(bench).values(), "bench console"):
        assert loaded.make_safe(DIED) is False
    begins, *between, _ends = entries("incident.jsonl")
    assert begins["event"] == "begins"
    assert [(each["role"], each["state"], each["took_s"]) for each in between] == [
        (role, "not reached", 0.0) for role in ROLES
    ]
    assert all("is in use by bench console" in each["why"] for each in between)
    assert devices["supply"].calls == []
    assert told().startswith("a run: NOT MADE SAFE: chamber, head, supply, source\n")
    assert set(read_unsafe(run)) == set(ROLES)
    assert made == []


def test_chambers_that_cannot_be_followed_are_on_record_and_safe(loaded, made, entries, monkeypatch):
    monkeypatch.setattr(module.Following, "problem", InputError("no such chamber"))
    assert loaded.make_safe(DIED) is True
    assert entries("incident.jsonl")[-1] == {
        "event": "alert", "problem": "the chambers cannot be followed: no such chamber",
    }  # fmt: skip


def test_an_alarm_is_on_record_and_told_at_once(loaded, entries, told, monkeypatch):
    loaded.alarm("head was not polled for 10 s")
    (thread,) = loaded._alerts
    assert (thread.name, thread.daemon) == ("alert", True)
    loaded.leave(Over())
    assert not thread.is_alive()
    assert entries("incident.jsonl") == [{"event": "alarm", "why": "head was not polled for 10 s"}]
    assert told() == "a run: look at it\na run: look at it\nhead was not polled for 10 s\n"


def test_an_alert_that_fails_is_told_and_on_record(loaded, entries, capfd):
    loaded._bench = loaded._bench.model_copy(
        update={"alert": loaded._bench.alert.model_copy(update={"exec": ("/no/program",)})}
    )
    loaded.alarm("it is late")
    loaded.leave(Over())
    *_, entry = entries("incident.jsonl")
    assert entry["event"] == "alert"
    assert entry["problem"].startswith("the alert program /no/program cannot be run")
    assert capfd.readouterr().err == f"a run: {entry['problem']}\n"


def test_without_an_alert_program_the_record_has_to_do(loaded, told):
    loaded._bench = loaded._bench.model_copy(update={"alert": None})
    assert loaded.make_safe(DIED) is True
    assert told() == ""


@pytest.mark.parametrize("end", [Over(("supply", "chamber"), ()), Over((), ("chamber",)), Over()])
def test_chambers_of_a_run_that_has_ended_are_followed_by_another_process(loaded, made, run, bench, monkeypatch, end):
    begun: list[partial[Any]] = []
    monkeypatch.setattr(module, "in_own_process", begun.append)
    loaded.leave(end)
    assert made == []
    assert len(begun) == bool(end.safe or end.held)
    for each in begun:
        by, found, safe, held = each().of
        assert (by, found.title, safe, held) == (guardian_of(run, 7), bench.title, end.safe, end.held)


def test_the_drivers_are_there_before_they_are_needed(run, bench, tmp_path, devices, made, monkeypatch):
    path, asked = tmp_path / "config" / "simulated.yaml", list[str]()
    monkeypatch.setattr(module, "device_of", lambda role, *_: asked.append(role))
    Rescue(run, Path(path), hashlib.sha256(path.read_bytes()).hexdigest(), 7)
    assert asked == ROLES
