"""Whoever holds an instrument is ended: politely, then not."""

from __future__ import annotations

import os
import signal
import time

from bench.runner.held import owners
from bench.runner.takeover import take_over
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
