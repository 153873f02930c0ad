"""Runs whose guardian had to act, or that left something on: latched until acknowledged, and again later."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bench.cli.main import main
from bench.clock import wall_utc
from bench.errors import InputError
from bench.guardian.notes import Notes
from bench.store.energised import note_energised, note_safe
from bench.store.latch import ACKNOWLEDGED, INCIDENT, acknowledge, latch
from bench.store.runs import MANIFEST, RunDirectory, summary
from bench.store.unsafe import write_unsafe
from tests.support.runs import run_short, sealed_anew


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.fixture
def run(smoke_copy) -> Path:
    """A run that ended well."""
    return smoke_copy


def incident(run: Path, why: str = "the process of the run has died", unsafe: tuple[str, ...] = ()) -> None:
    notes = Notes(run, INCIDENT)
    notes.entry("begins", why=why)
    notes.entry("ends", unsafe=dict.fromkeys(unsafe, "no answer"))
    notes.close()


def why(run: Path) -> str:
    found = latch(summary(run))
    return "" if found is None else found.why


def test_a_run_that_ended_well_is_not_latched(run):
    assert why(run) == ""
    with pytest.raises(InputError, match="is not latched"):
        acknowledge(run, "A. Person", "nothing")


def test_the_act_of_a_guardian_latches_until_it_is_acknowledged(run):
    incident(run, unsafe=("supply",))
    assert why(run) == (
        "its guardian made the bench safe: the process of the run has died; the guardian could not make supply safe"
    )
    assert acknowledge(run, "A. Person", "the fuse was replaced").startswith("its guardian")
    assert why(run) == ""
    (entry,) = map(json.loads, (run / ACKNOWLEDGED).read_text("utf-8").splitlines())
    assert (entry["by"], entry["reason"]) == ("A. Person", "the fuse was replaced")
    assert entry.keys() == {"at", "by", "reason", "of", "latch"}
    with pytest.raises(InputError, match="was acknowledged before"):
        acknowledge(run, "A. Person", "again")


def test_another_incident_latches_again(run):
    incident(run)
    acknowledge(run, "A. Person", "looked at")
    incident(run, why="the run stood still")
    assert "the run stood still" in why(run)


def test_the_acknowledgement_of_another_run_does_not_count(run, tmp_path):
    other = run_short(tmp_path / "others", sequence="smoke").path
    incident(other)
    acknowledge(other, "A. Person", "looked at")
    incident(run, why="no memory was left")
    (run / ACKNOWLEDGED).write_bytes((other / ACKNOWLEDGED).read_bytes())
    assert "no memory was left" in why(run)


def test_what_could_not_be_made_safe_latches(run):
    manifest = json.loads((run / MANIFEST).read_text("utf-8"))
    (run / MANIFEST).write_text(json.dumps({**manifest, "unsafe": {"supply": "no answer"}}), "utf-8")
    sealed_anew(run)
    assert why(run) == "supply could not be made safe: no answer"
    acknowledge(run, "A. Person", "switched off by hand")
    assert why(run) == ""


@pytest.mark.parametrize(
    ("by", "reason"),
    [("A. Person", "  "), ("A. Person", "a\nb"), ("A. Person", "x" * 501), ("", "x"), ("A" * 101, "x")],
)
def test_a_reason_and_a_name_are_needed(run, by, reason):
    incident(run)
    with pytest.raises(InputError, match=r"--reason: expected|--by: expected"):
        acknowledge(run, by, reason)
    assert why(run)


def test_a_run_under_way_is_not_acknowledged(run):
    incident(run)
    directory = RunDirectory.reopen(run)
    manifest = json.loads((run / MANIFEST).read_text("utf-8"))
    (run / MANIFEST).write_text(json.dumps({**manifest, "state": "running"}), "utf-8")
    try:
        with pytest.raises(InputError, match="is under way"):
            acknowledge(run, "A. Person", "looked at")
    finally:
        directory.release()


def test_what_may_still_be_on_comes_first(run, tmp_path):
    incident(run)
    note_energised(run, tmp_path / "b.yaml", wall_utc(), {"supply": "tcp://127.0.0.1:5025"})
    with pytest.raises(InputError, match=r"supply may still be energised. Make the bench safe first: .*b\.yaml"):
        acknowledge(run, "A. Person", "looked at")
    note_safe({"tcp://127.0.0.1:5025"})
    acknowledge(run, "A. Person", "looked at")


@pytest.mark.parametrize("how", ["symlink", "parent", "relative"])
def test_a_run_named_by_another_path_is_the_same_run(run, tmp_path, monkeypatch, how):
    incident(run)
    note_energised(run, tmp_path / "b.yaml", wall_utc(), {"supply": "tcp://127.0.0.1:5025"})
    monkeypatch.chdir(tmp_path)
    (tmp_path / "link").symlink_to(run)
    named = {"symlink": tmp_path / "link", "parent": run / ".." / run.name, "relative": run.relative_to(tmp_path)}[how]
    with pytest.raises(InputError, match="supply may still be energised"):
        acknowledge(named, "A. Person", "looked at")
    assert why(run)


def test_a_register_that_cannot_be_read_is_not_an_empty_one(run, tmp_path):
    incident(run)
    note_energised(run, tmp_path / "b.yaml", wall_utc(), {"supply": "tcp://127.0.0.1:5025"})
    (file,) = (tmp_path / "state").rglob("energised/*.json")
    file.write_text("{", "utf-8")
    with pytest.raises(InputError, match=r"whether its instruments are off is not known: .*cannot be read"):
        acknowledge(run, "A. Person", "looked at")
    assert why(run)


@pytest.mark.parametrize("unsafe", [[1], True, 3, "supply", {"supply": 1}, None])
def test_an_edited_incident_latches_its_run_and_hinders_no_other(run, unsafe, capsys):
    (run / "incident.jsonl").write_text(json.dumps({"event": "ends", "unsafe": unsafe}) + "\n", "utf-8")
    assert main(["runs", "--runs", str(run.parent)]) == 0
    assert "completed, latched" in capsys.readouterr().out


def test_nothing_from_an_incident_reaches_the_terminal_as_a_command(run, capsys):
    incident(run, why="\x1b]0;owned\x07\x1b[2Jdied\u202e")
    assert main(["status", str(run)]) == 0
    assert {"\x1b", "\x07", "\u202e"}.isdisjoint(shown := capsys.readouterr().out)
    assert "died" in shown


def test_an_alert_that_fails_later_is_no_other_incident(run):
    incident(run)
    acknowledge(run, "A. Person", "looked at")
    notes = Notes(run, INCIDENT)
    notes.entry("alert", problem="the alert program did not end")
    notes.close()
    assert why(run) == ""


def test_what_is_on_record_outside_of_the_run_latches_too(run, tmp_path):
    write_unsafe(run, wall_utc(), {"supply": "no answer"}, {"supply": "tcp://127.0.0.1:5025"})
    assert why(run) == "supply could not be made safe: no answer"
    assert why(run_short(tmp_path / "others", sequence="smoke").path) == ""
    acknowledge(run, "A. Person", "switched off by hand")
    assert why(run) == ""


def test_a_record_outside_of_the_run_that_cannot_be_read_latches(run, tmp_path):
    write_unsafe(run, wall_utc(), {"supply": "no answer"}, {}).write_text("[]", "utf-8")
    assert "could not be made safe" in why(run)


def test_lines_that_cannot_be_read_latch_too(run):
    (run / "incident.jsonl").write_bytes(b"\xff\x00 nonsense\n[1]\n")
    assert "incident.jsonl" in why(run)


def test_on_the_command_line(run, capsys):
    incident(run)
    assert main(["runs", "--runs", str(run.parent)]) == 0
    assert "completed, latched" in capsys.readouterr().out
    assert main(["status", str(run)]) == 0
    assert "bench acknowledge" in capsys.readouterr().out
    assert main(["acknowledge", str(run), "--reason", "looked at"]) == 0
    assert "acknowledged: its guardian made the bench safe" in capsys.readouterr().out
    assert main(["status", str(run)]) == 0
    assert "latched" not in capsys.readouterr().out
    assert main(["runs", "verify", str(run)]) == 0
    shown = capsys.readouterr()
    assert "not covered by the seal: acknowledged.jsonl" in shown.out + shown.err


def test_a_chamber_that_has_not_arrived_latches_and_a_damaged_entry_too(run):
    entry = {"event": "not_arrived", "role": "chamber", "why": "the air is at 60 °C"}
    lines = [json.dumps(entry), json.dumps({"event": "arrived", "role": "other"}), "{", json.dumps({})]
    (run / "followed.jsonl").write_text("\n".join(lines), "utf-8")
    assert why(run) == (
        "chamber has not arrived at its safe set point: the air is at 60 °C; "
        "a chamber has not arrived at its safe set point: unreadable; "
        "a chamber has not arrived at its safe set point: unreadable"
    )


def test_an_incident_without_a_begin_is_named(run):
    (run / INCIDENT).write_text(json.dumps({"event": "ends", "unsafe": "supply"}) + "\n", "utf-8")
    assert why(run) == "its guardian has written incident.jsonl; the guardian could not make supply safe"


def test_what_another_run_has_left_on_holds_up_no_acknowledgement(run, tmp_path):
    incident(run)
    note_energised(tmp_path / "other", tmp_path / "b.yaml", wall_utc(), {"supply": "tcp://127.0.0.1:5025"})
    acknowledge(run, "A. Person", "looked at")
    assert why(run) == ""


def test_what_is_held_by_a_guardian_may_be_on(run, tmp_path):
    incident(run)
    connections = {"chamber": "tcp://127.0.0.1:1502", "supply": "tcp://127.0.0.1:5025"}
    note_energised(run, tmp_path / "b.yaml", wall_utc(), connections)
    with pytest.raises(InputError, match=r": supply may still be energised"):
        acknowledge(run, "A. Person", "looked at", lambda address: address.endswith(":1502"))
    acknowledge(run, "A. Person", "looked at", lambda _address: True)


def test_what_is_not_safe_has_its_address_on_record(run, tmp_path):
    at = wall_utc()
    path = write_unsafe(run, at, {"supply": "no answer", "head": "stuck"}, {"supply": "tcp://127.0.0.1:5025"})
    assert json.loads(path.read_text("utf-8")) == {
        "schema": "itb-unsafe/1", "run": str(run), "at": at.isoformat(timespec="seconds"),
        "unsafe": {
            "supply": {"why": "no answer", "connection": "tcp://127.0.0.1:5025"},
            "head": {"why": "stuck", "connection": ""},
        },
    }  # fmt: skip
    assert why(run) == "supply could not be made safe: no answer; head could not be made safe: stuck"
