"""What is on, and who works at a bench, is known to all users of a computer."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest

from bench.app import preflight
from bench.app.execute import execute
from bench.app.make_safe import make_safe
from bench.app.request import RunRequest, prepare
from bench.config.bench import load_bench
from bench.errors import InUseError, StoreError
from bench.runner.held import address_lock, energising_addresses
from bench.runner.quiet import Quiet
from bench.store.energised import energised, note_energised, note_safe, record_made_safe
from bench.store.lockout import lift, lock_out, locked_out, lockouts
from bench.store.machine_state import FOLDERS, VARIABLE, problem_to_read, problem_to_write
from drivers.transport.address import Address
from tests.support.runs import ROOT
from tests.support.served import on_real_wires

SUPPLY, AT = "tcp://10.0.0.1:5025", datetime(2026, 1, 1, tzinfo=UTC)
GROUP, OTHERS, ALICE, BOB = 47110, 47111, 47112, 47113
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only the administrator becomes another user")
AS_ANOTHER = """
import os, sys
from datetime import UTC, datetime
from pathlib import Path
from bench.app.beginning import Register
from bench.config.bench import load_bench
from bench.store.energised import energised, note_energised, note_safe, record_made_safe
from bench.store.lockout import lift, lock_out, locked_out, lockouts
from bench.store.machine_state import append_record, problem_to_read, problem_to_write
from bench.store.unsafe import write_unsafe, read_unsafe
loaded = load_bench(Path("config/simulated_wires.yaml"))
AT, SUPPLY = datetime(2026, 1, 1, tzinfo=UTC), "tcp://10.0.0.1:5025"
user, group = map(int, sys.argv[1:])
os.umask(0o077)
os.setgroups([group])
os.setgid(user)
os.setuid(user)
"""


@pytest.fixture
def place() -> Iterator[Path]:
    """A folder into which all users may look."""
    folder = Path(tempfile.mkdtemp(prefix="itb-state-"))
    folder.chmod(0o755)
    yield folder
    shutil.rmtree(folder)


@pytest.fixture
def machine(place: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the machine, as the administrator makes it, and one for each user."""
    folder = place / "machine"
    for path in (folder, *(folder / name for name in FOLDERS)):
        path.mkdir()
        if os.geteuid() == 0:
            os.chown(path, 0, GROUP)
        path.chmod(0o2770)
    monkeypatch.setenv(VARIABLE, str(folder))
    monkeypatch.setenv("XDG_STATE_HOME", str(place / str(os.geteuid())))
    return folder


def by(user: int, code: str, *, group: int = GROUP) -> str:
    """What Python prints as another user, a member of the group, whose umask lets nobody else in."""
    own = Path(os.environ[VARIABLE]).parent / str(user)
    own.mkdir(exist_ok=True)
    os.chown(own, user, user)
    done = subprocess.run(
        [sys.executable, "-c", AS_ANOTHER + code, str(user), str(group)],
        capture_output=True, text=True, cwd=ROOT, check=False, env={**os.environ, "XDG_STATE_HOME": str(own)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def left() -> list[tuple[str, dict[str, str]]]:
    return [(each.name, dict(each.connections)) for each in energised(pytest.fail)]


@pytest.mark.lengthy
@as_root
def test_what_one_user_left_on_is_known_to_another_who_makes_it_safe(machine):
    by(ALICE, "note_energised(Path('/runs/a'), Path('/b.yaml'), AT, {'supply': SUPPLY, 'source': 'tcp://10.0.0.1:1'})")
    show = "print([(each.name, dict(each.connections)) for each in energised(print)])"
    assert by(BOB, show) == f"[('a', {{'supply': '{SUPPLY}', 'source': 'tcp://10.0.0.1:1'}})]"
    by(BOB, "note_safe([SUPPLY])")
    assert by(ALICE, show) == "[('a', {'source': 'tcp://10.0.0.1:1'})]"
    by(ALICE, "note_safe(['tcp://10.0.0.1:1'])")
    assert left() == []


@pytest.mark.lengthy
@as_root
def test_a_lockout_of_one_user_holds_and_is_lifted_by_another(machine):
    by(ALICE, "lock_out(Path('/b.yaml'), AT, 'Alice', 'the coil', {'supply': SUPPLY})")
    assert by(BOB, "print(locked_out([SUPPLY]))").startswith("locked out by Alice")
    by(BOB, "lift(Path('/b.yaml'), AT, 'Bob', 'done')")
    assert by(ALICE, "print(locked_out([SUPPLY]))") == ""
    log = [json.loads(line) for line in (machine / "lockouts.jsonl").read_text("utf-8").splitlines()]
    assert [(entry["what"], entry["by"]) for entry in log] == [("set", "Alice"), ("lifted", "Bob")]


@pytest.mark.lengthy
@as_root
def test_what_was_not_made_safe_and_how_benches_were_made_safe_is_of_all_users(machine):
    by(ALICE, "write_unsafe(Path('/runs/a'), AT, {'supply': 'no answer'}, {})")
    by(BOB, "write_unsafe(Path('/bob/a'), AT, {'source': 'no answer'}, {})")
    assert by(BOB, "print(read_unsafe(Path('/runs/a')))") == "{'supply': 'no answer'}"
    by(ALICE, "record_made_safe(Path('/b.yaml'), AT, [])")
    by(BOB, "record_made_safe(Path('/b.yaml'), AT, [])")
    assert len((machine / "made_safe.jsonl").read_text("utf-8").splitlines()) == 2


@as_root
def test_files_are_for_the_group_and_nobody_else_whatever_the_umask(machine):
    by(
        ALICE,
        "note_energised(Path('/runs/a'), Path('/b.yaml'), AT, {'supply': SUPPLY}); append_record('x.jsonl', '{}')",
    )
    files = [path for path in machine.rglob("*") if path.is_file()]
    assert len(files) == 2
    assert {(path.stat().st_mode & 0o777, path.stat().st_gid) for path in files} == {(0o660, GROUP)}


@pytest.mark.lengthy
@as_root
def test_who_is_not_of_the_group_reads_that_and_does_not_pass_for_knowing(machine):
    assert "may not read" in by(ALICE, "print(problem_to_read())", group=OTHERS)
    assert "join its group" in by(ALICE, "print(problem_to_write())", group=OTHERS)
    by(BOB, "lock_out(Path('/b.yaml'), AT, 'Bob', 'the coil', {'supply': SUPPLY})")
    assert "is not known" in by(ALICE, "print(locked_out([SUPPLY]))", group=OTHERS)
    reported = by(ALICE, "note_energised(Path('/runs/a'), Path('/b.yaml'), AT, {'supply': SUPPLY})\n"
                     "print([each.name for each in energised(print)])", group=OTHERS)  # fmt: skip
    assert "what runs of other users have left on is not known" in reported
    assert reported.endswith("['a']")  # its own folder has it
    assert left() == []


@pytest.mark.lengthy
@as_root
def test_who_may_only_read_is_held_back_by_a_lockout_and_told_that_its_own_records_are_not_seen(machine):
    by(BOB, "lock_out(Path('/b.yaml'), AT, 'Bob', 'the coil', {'supply': SUPPLY})")
    for path in (machine, *machine.rglob("*")):
        path.chmod(0o2775 if path.is_dir() else 0o664)
    assert by(ALICE, "print(problem_to_read())", group=OTHERS) == ""
    assert "may not write to" in by(ALICE, "print(problem_to_write())", group=OTHERS)
    assert by(ALICE, "print(locked_out([SUPPLY]))", group=OTHERS).startswith("locked out by Bob")
    reported = by(ALICE, "Register(loaded, Path('/runs/a'), print).begin(AT)", group=OTHERS)
    assert "may not write to" in reported
    assert "'bench make-safe' of other users does not know of this run" in reported


@as_root
def test_an_entry_that_a_user_may_not_change_keeps_none_of_its_own(machine):
    note = "note_energised(Path('/runs/a'), Path('/b.yaml'), AT, {'supply': SUPPLY})"
    by(BOB, note)
    machine.joinpath("energised").chmod(0o2755)
    next((machine / "energised").iterdir()).chmod(0o664)
    tried = f"{note}\ntry: note_safe([SUPPLY])\nexcept Exception as problem: print(type(problem).__name__)"
    assert by(ALICE, tried) == "StoreError"
    own = Path(os.environ[VARIABLE]).parent / str(ALICE) / "inertial-test-bench" / "energised"
    assert list(own.iterdir()) == []


@as_root
def test_a_folder_into_which_a_user_may_not_even_look_counts_as_there(place, machine):
    machine.rename(place / "closed")
    (outer := place / "outer").mkdir()
    (place / "closed").rename(outer / "machine")
    outer.chmod(0o700)
    os.environ[VARIABLE] = str(outer / "machine")
    assert "may not read" in by(ALICE, "print(problem_to_read())")


def test_without_such_a_folder_everything_is_of_the_user(place, monkeypatch):
    monkeypatch.setenv(VARIABLE, str(place / "none"))
    monkeypatch.setenv("XDG_STATE_HOME", str(place))
    note_energised(Path("/runs/a"), Path("/b.yaml"), AT, {"supply": SUPPLY})
    assert (problem_to_read(), problem_to_write(), left()) == ("", "", [("a", {"supply": SUPPLY})])
    assert len(list((place / "inertial-test-bench" / "energised").iterdir())) == 1


def test_what_a_user_recorded_before_the_machine_had_a_folder_is_seen_and_taken_out(machine, monkeypatch):
    shared = os.environ[VARIABLE]
    monkeypatch.setenv(VARIABLE, "/none")
    note_energised(Path("/runs/a"), Path("/b.yaml"), AT, {"supply": SUPPLY})
    lock_out(Path("/b.yaml"), AT, "A", "x", {"supply": SUPPLY})
    monkeypatch.setenv(VARIABLE, shared)
    assert (len(left()), locked_out([SUPPLY])[:15]) == (1, "locked out by A")
    note_safe([SUPPLY])
    lift(Path("/b.yaml"), AT, "A", "x")
    assert (left(), locked_out([SUPPLY])) == ([], "")


@pytest.mark.parametrize("missing", FOLDERS)
def test_a_folder_that_was_set_up_in_part_is_named(machine, missing):
    (machine / missing).rmdir()
    assert f"{machine / missing} is missing" in problem_to_write()
    (machine / missing).write_text("", "utf-8")
    assert "is not a folder" in problem_to_write()


@as_root
def test_a_link_in_place_of_a_folder_leads_nobody_elsewhere(place, machine):
    (elsewhere := place / "elsewhere").mkdir()
    (machine / "energised").rmdir()
    (machine / "energised").symlink_to(elsewhere)
    note_energised(Path("/runs/a"), Path("/b.yaml"), AT, {"supply": SUPPLY})
    assert list(elsewhere.iterdir()) == []
    assert "is not a folder" in problem_to_write()


def odd(path: Path, kind: str, place: Path) -> None:
    entry = {"schema": "itb-energised/1", "run": "/r", "bench": "/b", "since": "", "connections": {}}
    if kind == "folder":
        path.mkdir()
    elif kind == "dangling link":
        path.symlink_to(place / "nothing")
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "link to a device":
        path.symlink_to("/dev/zero")
    elif kind == "unreadable":
        path.write_text("{}", "utf-8")
        path.chmod(0)
        os.chown(path, BOB, GROUP)
    elif kind == "no path":
        path.write_text(json.dumps(entry | {"run": "a\0b"}), "utf-8")
    elif kind == "a name of a bench":
        path.write_text(json.dumps(entry | {"bench": "simulated"}), "utf-8")
    else:
        path.write_text(kind, "utf-8")


ODD = ("folder", "dangling link", "pipe", "link to a device", "no path", "a name of a bench", "", "[]", "{" * 9999)


@pytest.mark.parametrize("kind", ODD)
def test_what_is_no_record_is_reported_hides_no_other_and_locks_out(place, machine, kind):
    note_energised(Path("/runs/a"), Path("/b.yaml"), AT, {"supply": SUPPLY})
    for name in ("energised", "lockouts"):
        odd(machine / name / "0\x1b[2J.json", kind, place)
    problems: list[StoreError] = []
    assert [each.name for each in energised(problems.append)] == ["a"]
    assert len(problems) == 1
    assert str(problems[0]).isprintable()
    assert "is not known" in (why := locked_out([SUPPLY]))
    assert why.isprintable()
    note_safe([SUPPLY])
    assert [each.name for each in energised(lambda _: None)] == []


@as_root
def test_a_record_that_this_user_may_not_read_locks_out(machine, place):
    odd(machine / "lockouts" / "0.json", "unreadable", place)
    assert "is not known" in by(ALICE, "print(locked_out([SUPPLY]))")


def test_words_of_others_reach_no_terminal_as_commands(machine):
    note_energised(Path("/runs/a\x1b[2J"), Path("/b\x1b.yaml"), AT, {"supply\x07": SUPPLY})
    (record := machine / "lockouts" / "0.json").touch()
    entry = {"schema": "itb-lockout/1", "bench": "/b", "since": "", "by": "\x1b[2J", "reason": "", "connections": {}}
    record.write_text(json.dumps(entry | {"connections": {"supply": SUPPLY}}), "utf-8")
    message: list[str] = []
    list(make_safe(None, message.append, lambda lane: message.append(lane.why)))
    assert any("not known to be safe" in text for text in message)
    assert all(text.isprintable() for text in [*message, locked_out([SUPPLY])])


@as_root
def test_a_link_in_place_of_a_record_or_of_a_log_leads_no_writing_elsewhere(place, machine):
    secret = place / "secret"
    secret.write_text("kept", "utf-8")
    lock_out(Path("/b.yaml"), AT, "A", "x", {"supply": SUPPLY})
    (record,) = (machine / "lockouts").glob("*.json")
    record.unlink()
    record.symlink_to(secret)
    (machine / "made_safe.jsonl").symlink_to(secret)
    lock_out(Path("/b.yaml"), AT, "A", "x", {"supply": SUPPLY})
    with pytest.raises(StoreError, match="cannot be recorded"):
        record_made_safe(Path("/b.yaml"), AT, [])
    assert (secret.read_text("utf-8"), record.is_symlink(), len(list(lockouts()))) == ("kept", False, 1)


def test_two_who_write_one_record_at_once_leave_a_whole_one(machine):
    def write(who: str) -> None:
        for _ in range(50):
            lock_out(Path("/b.yaml"), AT, who, who * 400, {"supply": SUPPLY})

    writing = [threading.Thread(target=write, args=(who,)) for who in "AB"]
    for thread in writing:
        thread.start()
    while any(thread.is_alive() for thread in writing):
        assert {each.reason for each in lockouts()} <= {"A" * 400, "B" * 400}
    for thread in writing:
        thread.join()
    assert [path.suffix for path in (machine / "lockouts").iterdir()] == [".json"]


@as_root
def test_a_run_of_another_user_that_is_under_way_is_not_made_safe_by_the_service(place, machine):
    bench = on_real_wires(place)
    address = str(energising_addresses(load_bench(bench).bench)["supply"])
    note_energised(Path("/home/alice/no/right/a"), bench, AT, {"supply": address})
    message: list[str] = []
    with address_lock([Address.parse(address)], "a run of smoke"):
        assert list(make_safe(None, message.append, lambda _: None, if_left_on=True)) == []
    assert message == []


def test_preflight_says_whose_register_it_is(machine, monkeypatch):
    assert preflight._register().state == "ok"
    (machine / "unsafe").rmdir()
    assert (preflight._register().state, "is missing" in preflight._register().text) == ("NO", True)
    monkeypatch.setenv(VARIABLE, "/none")
    assert preflight._register().state == "look"


@as_root
def test_a_run_says_that_the_records_are_out_of_reach(place, machine):
    bench = on_real_wires(place)
    (machine / "unsafe").rmdir()
    prepared = prepare(RunRequest("smoke", bench=str(bench), units=("QF-0001",), runs=place / "runs"))
    with pytest.raises(InUseError, match=r"is not known .*is missing: make it with 'systemd-tmpfiles"):
        execute(prepared, Quiet())
