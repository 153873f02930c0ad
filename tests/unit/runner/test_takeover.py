"""Whoever holds an instrument is ended: politely, then not."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

from bench.runner import takeover as module
from bench.runner.held import LOOKS, Kind, Owner, address_lock, owners
from bench.runner.takeover import end_supervision, take_over
from drivers.transport.address import Address
from tests.support.guardians import stop
from tests.unit.runner.test_held import HOST, NOBODY, another, hold

AT = [Address.parse(HOST)]


def taken_over(end_within_s: float = 5.0) -> list[str]:
    reported: list[str] = []
    take_over(AT, reported.append, end_within_s)
    return reported


def test_nobody_is_ended_where_nobody_holds_it():
    assert taken_over() == []


def test_a_program_that_holds_it_is_told_to_end():
    with another(HOST) as process:
        (reported,) = taken_over()
        assert reported == f"Ending a run of smoke, process {process}, which has instruments of this bench."
        with hold(HOST):
            pass


def test_a_program_that_stands_still_is_killed():
    with another(HOST) as process:
        stop(process)
        begun_s = time.monotonic()
        _, reported = taken_over(0.5)
        assert reported.endswith("did not release them within 0.5 s and is killed.")
        assert time.monotonic() - begun_s < 10
        with hold(HOST):
            pass


def test_this_program_does_not_end_itself():
    with hold(HOST):
        (reported,) = taken_over()
        assert "cannot be ended" in reported
        assert [owner.process for owner in owners(AT)] == [os.getpid()]


def test_a_program_of_another_user_is_named_where_it_may_not_be_ended(monkeypatch):
    def refused(process: int, number: int) -> None:
        raise PermissionError(process, number)

    monkeypatch.setattr(signal, "pidfd_send_signal", refused)  # as for everybody but root
    with another(HOST, NOBODY):
        reported = taken_over()
        assert "user nobody" in reported[-1]
        assert "may not end it" in reported[-1]
        assert owners(AT)


def test_a_program_that_goes_meanwhile_is_not_waited_for(monkeypatch):
    pauses: list[float] = []
    monkeypatch.setattr("bench.runner.takeover._pause", lambda limit_s: bool(pauses.append(limit_s)))
    with another(HOST) as process:
        stop(process)
        reported = taken_over(1.0)
        assert len(reported) == 2
    assert pauses[:4] == [0.25] * 4


def test_one_that_does_not_die_is_named_as_dangerous(monkeypatch):
    sent: list[int] = []
    monkeypatch.setattr(signal, "pidfd_send_signal", lambda _process, number: sent.append(number))
    monkeypatch.setattr("bench.runner.takeover._pause", lambda _limit_s: False)
    with another(HOST) as process:
        reported = taken_over(1.0)
    assert sent == [signal.SIGTERM, signal.SIGKILL]
    assert reported[1:] == [
        f"a run of smoke, process {process} did not release them within 1 s and is killed.",
        f"a run of smoke, process {process} does not end. It may still send commands to instruments of this bench.",
    ]


def test_a_short_look_ends_by_itself():
    with address_lock(AT, "a short look", Kind.VISIT):
        assert taken_over() == []


class Supervision:
    """Programs that follow a chamber, as they are found: `found` again and again, until they were told to end."""

    def __init__(self, monkeypatch, *found: Owner) -> None:
        self.told, self.pauses, self._found = list[tuple[int, int]](), list[float](), set(found)
        monkeypatch.setattr(module, "owners", self._owners)
        monkeypatch.setattr(module, "_pause", lambda limit_s: bool(self.pauses.append(limit_s)))
        monkeypatch.setattr(signal, "pidfd_send_signal", self._send)

    def _owners(self, addresses: object, purpose: str) -> set[Owner]:
        assert (addresses, purpose) == (AT, LOOKS)
        return set() if len(self.pauses) == 2 else self._found

    def _send(self, process: int, number: int) -> None:
        text = Path(f"/proc/self/fdinfo/{process}").read_text("ascii")
        (found,) = (int(line.split()[1]) for line in text.splitlines() if line.startswith("Pid:"))
        self.told.append((found, number))


def test_who_follows_a_chamber_hands_the_bench_over(monkeypatch):
    found, notices = Supervision(monkeypatch, Owner(os.getpid(), 0, "the guardian of a run", Kind.VISIT)), list[str]()
    end_supervision(AT, notices.append)
    assert found.told == [(os.getpid(), signal.SIGTERM)]
    assert notices == ["the guardian of a run hands the bench over."]
    assert found.pauses == [0.25] * 2


def test_who_does_not_is_waited_for_for_a_while(monkeypatch):
    found = Supervision(monkeypatch, Owner(os.getpid(), 0, "the guardian of a run", Kind.VISIT))
    found._owners = lambda *_: found._found
    monkeypatch.setattr(module, "owners", found._owners)
    end_supervision(AT, lambda _text: None)
    assert sum(found.pauses) == module.RELIEVED_WITHIN_S


@pytest.mark.parametrize("problem", [ProcessLookupError, PermissionError])
def test_who_cannot_be_told_is_left(monkeypatch, problem):
    Supervision(monkeypatch, Owner(os.getpid(), 0, "the guardian of a run", Kind.VISIT))
    notices: list[str] = []

    def fails(*_arguments: object) -> None:
        raise problem

    monkeypatch.setattr(signal, "pidfd_send_signal", fails)
    end_supervision(AT, notices.append)
    assert notices == []


def test_another_process_with_its_number_is_not_told(monkeypatch):
    found = Supervision(monkeypatch)
    answers = [{Owner(os.getpid(), 0, "the guardian of a run", Kind.VISIT)}, set()]
    monkeypatch.setattr(module, "owners", lambda *_: answers.pop(0) if answers else set())
    end_supervision(AT, lambda _text: None)
    assert found.told == []
