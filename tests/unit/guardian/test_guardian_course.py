"""The course of a chamber after its run, judged from its readings alone."""

from __future__ import annotations

import pytest

from bench.guardian.course import GONE_S, Course, Noted
from drivers.values import ChamberState
from tests.support.guarded import at

HOLD_S = 1800.0


@pytest.fixture
def entry(bench):
    return bench.devices["chamber"]


@pytest.fixture
def held(entry) -> Course:
    """A chamber that is held at 60 °C from 100 s on."""
    return Course(entry, 100.0, held=True)


@pytest.fixture
def sent(entry) -> Course:
    """A chamber that was commanded to its safe set point at 100 s."""
    return Course(entry, 100.0, held=False)


def test_a_course_begins_as_the_run_left_it(held, sent):
    assert (held.is_held, held.is_over, held.hold_ends_s, held.target_c) == (True, False, 100 + HOLD_S, 25.0)
    assert (sent.is_held, sent.is_over, sent.hold_ends_s, sent.target_c) == (False, False, 100.0, 25.0)
    for each in (held, sent):
        assert (each.hold_is_over, each.why_unseen, each.state, each.end, each.noted) == ("", "", None, None, [])


def test_air_at_the_safe_set_point_has_arrived(sent):
    sent.seen(101.0, at(60.0, 25.0))
    assert (sent.is_over, sent.noted, sent.state) == (False, [], at(60.0, 25.0))
    sent.seen(700.0, at(27.0, 25.0))
    assert sent.is_over
    assert sent.end == Noted("arrived", "", 27.0, 25.0)
    assert sent.noted == [sent.end]


def test_air_that_cannot_arrive_ends_the_course_with_the_reason(sent):
    sent.seen(101.0, at(60.0, 25.0))
    sent.seen(200.0, at(59.0, 40.0))
    why = "the set point was changed by another master from 25 °C to 40 °C"
    assert (sent.is_over, sent.end) == (True, Noted("not_arrived", why, 59.0, 40.0))
    assert sent.noted == [sent.end]


def test_the_time_of_a_reading_counts(sent):
    sent.seen(101.0, at(60.0, 25.0))
    sent.seen(500.0, at(60.0, 25.0))
    assert not sent.is_over
    sent.seen(701.0, at(60.0, 25.0))
    assert sent.end is not None
    assert sent.end.why.startswith("the air has not come 1 °C closer")


def test_readings_of_a_held_chamber_are_on_record_with_the_distance_of_the_last_command(held):
    held.seen(101.0, ChamberState(59.5, 60.0, 60.0, 35.0))
    held.seen(130.0, ChamberState(59.9, 60.0, 60.2, 35.0))
    held.seen(160.0, ChamberState(59.9, 60.0, 60.5, 35.0))
    assert held.noted == [
        Noted("held", "", 59.5, 60.0, 35.0),
        Noted("reading", "", 59.9, 60.2, 35.0),
        Noted("reading", "", 59.9, 60.5, 35.0),
    ]
    assert (held.hold_is_over, held.is_over, held.is_held) == ("", False, True)


def test_a_hold_ends_when_its_time_is_over(held):
    held.seen(101.0, at(60.0, 60.0))
    held.seen(100 + HOLD_S - 1, at(60.0, 60.0))
    assert held.hold_is_over == ""
    held.seen(100 + HOLD_S, at(60.0, 60.0))
    assert held.hold_is_over == "the hold time has expired"


def test_a_hold_ends_when_another_master_changes_the_set_point(held):
    held.seen(101.0, at(60.0, 60.0))
    held.seen(130.0, at(60.0, 60.0, 60.6))
    why = "another master changed the set point from 60 °C to 60.6 °C"
    assert held.hold_is_over == why
    held.seen(3000.0, at(60.0, 60.0))
    assert held.hold_is_over == why  # the first reason stays
    changed_late = "another master changed the set point from 60 °C to 50 °C"
    held.hold_is_over = ""
    held.seen(3001.0, at(60.0, 60.0, 50.0))
    assert held.hold_is_over == changed_late


def test_a_hold_ends_when_the_air_leaves(held):
    for at_s, air_c in ((101.0, 60.0), (130.0, 64.0), (160.0, 70.0)):
        held.seen(at_s, at(air_c, 60.0))
    assert held.hold_is_over.startswith("the air moves away from its set point: 6.0 °C farther")


def test_a_failed_reading_of_a_held_chamber_is_on_record_and_a_good_one_takes_it_back(held):
    held.unseen(110.0, "no answer")
    assert (held.why_unseen, held.noted, held.hold_is_over) == ("no answer", [Noted("not_seen", "no answer")], "")
    held.seen(120.0, at(60.0, 60.0))
    assert held.why_unseen == ""


def test_a_hold_that_is_not_seen_ends_in_time(held):
    held.unseen(100 + HOLD_S - 1, "no answer")
    assert held.hold_is_over == ""
    held.unseen(100 + HOLD_S, "no answer")
    assert (held.hold_is_over, held.is_over) == ("the hold time has expired", False)
    held.hold_is_over = "another reason"
    held.unseen(100 + HOLD_S + 1, "no answer")
    assert held.hold_is_over == "another reason"


def test_a_held_chamber_that_stays_unseen_is_given_up_and_not_safe(held):
    held.unseen(100 + HOLD_S + GONE_S, "no answer", in_use=True)
    assert not held.is_over
    held.unseen(100 + HOLD_S + GONE_S + 1, "no answer", in_use=True)
    assert held.end == Noted("not_arrived", "it is still held, and COULD NOT BE MADE SAFE for 10 min: no answer")


def test_a_chamber_that_stays_unseen_is_given_up(sent):
    sent.unseen(100 + GONE_S, "no answer")
    assert (sent.is_over, sent.noted, sent.why_unseen) == (False, [], "no answer")
    sent.unseen(100 + GONE_S + 1, "no answer")
    assert sent.end == Noted("not_arrived", "its air could not be read for 10 min: no answer")


def test_one_that_was_seen_meanwhile_is_not(sent):
    sent.seen(400.0, at(60.0, 25.0))
    sent.unseen(400 + GONE_S, "no answer")
    assert not sent.is_over


def test_one_that_another_program_keeps_is_handed_over(sent):
    sent.unseen(100 + GONE_S, "in use by a run", in_use=True)
    assert not sent.is_over
    sent.unseen(100 + GONE_S + 1, "in use by a run", in_use=True)
    assert sent.end == Noted("handed_over", "in use by a run")


def test_a_command_ends_the_hold_and_begins_the_time_anew(held):
    held.hold_is_over = "its guardian was ended"
    held.commanded(500.0)
    assert (held.is_held, held.hold_ends_s) == (False, 500.0)
    assert held.noted == [Noted("hold_ends", "its guardian was ended"), Noted("commanded", set_point_c=25.0)]
    held.unseen(500 + GONE_S, "no answer")
    assert not held.is_over


def test_a_command_without_a_hold_is_on_record_alone(sent):
    sent.commanded(500.0)
    assert sent.noted == [Noted("commanded", set_point_c=25.0)]
    sent.unseen(500 + GONE_S, "no answer")
    assert not sent.is_over


@pytest.mark.parametrize(
    ("end", "noted"),
    [
        (lambda course: course.hand_over("a run"), Noted("handed_over", "a run")),
        (lambda course: course.lock_out("locked out by A."), Noted("not_arrived", "the bench is locked out by A.")),
        (lambda course: course.leave("it was enough"), Noted("ended", "it was enough")),
    ],
)
def test_a_course_ends_before_arrival(sent, end, noted):
    end(sent)
    assert (sent.is_over, sent.end, sent.noted) == (True, noted, [noted])
