"""What is shown of each bench, and in which order."""

from datetime import timedelta

import pytest

from bench.figures.languages import language
from bench.overview.cards import Kind, counts
from bench.overview.words import Words
from tests.support.overview import NOW, Told


def kinds(told):
    return [(card.title, card.kind) for card in told.cards()]


def words(told, zone="Europe/Berlin"):
    return Words(told.card(), told.now, zone)


def test_what_waits_for_a_person_is_first_then_alarms_then_runs_by_their_end_then_the_rest():
    told = Told().online().idle("idle").state("late", ends=NOW + timedelta(hours=9)).state("soon").idle("10").idle("9")
    told.state("alarm", problems=("hot",)).state("held", held_by=("interlock 'hot'",)).idle(
        "stopped", stopped="interrupted"
    )
    told.state("paused", held_by=("operator",)).state("asks").asks(bench="asks")
    told.online("dead").state("a", "dead", title="lost").offline("dead")
    told.offline("old", retained=True).idle(
        "a", station="old", title="gone", at=NOW - timedelta(days=90), retained=True
    )
    assert kinds(told) == [
        ("Bench asks", Kind.ASKS), ("Bench paused", Kind.PAUSED), ("Bench alarm", Kind.ALARM),
        ("Bench held", Kind.ALARM), ("Bench stopped", Kind.ALARM), ("lost", Kind.LOST),
        ("Bench soon", Kind.RUNNING), ("Bench late", Kind.RUNNING), ("Bench 9", Kind.IDLE),
        ("Bench 10", Kind.IDLE), ("Bench idle", Kind.IDLE), ("gone", Kind.GONE),
    ]  # fmt: skip
    assert counts(told.cards())[Kind.ALARM] == 3


def test_a_question_goes_when_it_is_answered():
    told = Told().online().state().asks("Turn it over.")
    assert told.card().questions[0].text == "Turn it over."
    assert told.later(minutes=5).asks("Turn it over.").card().since == NOW, "it is the same"
    assert told.asks("Another").card().since == NOW + timedelta(minutes=5)
    assert told.tell("lab/a/questions", b"").card().kind is Kind.RUNNING


def test_benches_keep_their_places_while_their_ends_move_a_little():
    told = Told().online().state("b", ends=NOW + timedelta(minutes=61)).state("c", ends=NOW + timedelta(minutes=62))
    before = kinds(told)
    assert kinds(told.state("b", ends=NOW + timedelta(minutes=64))) == before


def test_the_last_will_of_a_station_is_a_lost_contact_at_once_with_when_it_was_heard():
    told = Told().online().state().later(minutes=1).online().later(seconds=90).offline(title="Laboratory")
    card = told.later(minutes=2).card()
    assert (card.kind, card.before, card.silent_min) == (Kind.LOST, Kind.RUNNING, 3)
    assert words(told).heard == "last heard 3 min ago"
    assert told.online(bd_seq=2).card().kind is Kind.RUNNING


def test_the_will_of_an_older_connection_says_nothing():
    told = Told().online(bd_seq=1).state().online(bd_seq=2).offline(bd_seq=1)
    assert told.card().kind is Kind.RUNNING
    assert told.offline(bd_seq=2).card().kind is Kind.LOST


def test_a_station_that_ends_says_so():
    told = Told().online().idle().offline(at=NOW)
    assert told.card().has_ended
    assert words(told).heard == "the station was ended at 13:00"


def test_a_silent_station_is_lost_after_three_minutes_and_gone_after_a_day():
    told = Told().online().state().later(seconds=170)
    assert told.card().kind is Kind.RUNNING
    assert told.later(seconds=20).card().kind is Kind.LOST
    assert told.later(days=1).card().kind is Kind.GONE
    assert told.online().card().kind is Kind.RUNNING


def test_nobody_is_lost_while_the_broker_is_away_nor_at_once_when_it_is_back():
    told = Told().online().state()
    told.overview.disconnected(told.now)
    assert told.later(minutes=30).card().kind is Kind.RUNNING
    told.overview.subscribed(told.now)
    assert told.card().kind is Kind.RUNNING
    assert told.later(minutes=4).card().kind is Kind.LOST


def test_a_broker_that_ends_publishes_all_last_wills_and_yet_nobody_is_lost():
    told = Told().online().state().later(seconds=30).online("dead", bd_seq=7).state("b", "dead")
    told.offline("dead", bd_seq=7).later(seconds=60).offline()
    told.overview.disconnected(told.later(seconds=1).now)
    assert kinds(told) == [("Bench b", Kind.LOST), ("Bench a", Kind.RUNNING)]
    told.overview.subscribed(told.later(seconds=20).now)
    told.offline(retained=True).offline("dead", bd_seq=7, retained=True).state(retained=True)
    told.state("b", "dead", retained=True)
    told.overview.settled()
    assert kinds(told) == [("Bench b", Kind.LOST), ("Bench a", Kind.RUNNING)]
    assert {card.kind for card in told.later(seconds=200).cards()} == {Kind.LOST}, "it has not come back"


def test_what_the_broker_does_not_send_again_was_removed_meanwhile():
    told = Told().online().state().asks().state("b").online("other").state("a", "other")
    told.overview.disconnected(told.now)
    told.overview.subscribed(told.now)
    told.online(retained=True).state(retained=True)
    assert told.cards()[0].kind is Kind.ASKS, "until the broker has sent all"
    told.overview.settled()
    assert kinds(told) == [("Bench a", Kind.RUNNING)]


@pytest.mark.parametrize("status", ["online", "offline"])
def test_a_station_that_died_months_ago_is_gone_whatever_the_broker_has_kept(status):
    then = NOW - timedelta(days=100)
    told = Told()
    if status == "online":
        told.online(at=then, retained=True)
    else:
        told.offline(retained=True)
    told.state(at=then, ends=then, retained=True)
    assert told.card().kind is Kind.GONE
    assert words(told).heard == "last heard 2026-08-19 14:00"


def test_of_a_station_that_was_offline_before_nothing_is_known_but_its_last_state():
    told = Told().offline(retained=True).tell("lab/a/state", b'{"title": "Left"}', retained=True)
    assert told.card().kind is Kind.LOST
    assert words(told).heard == "not heard since this page was started"
    assert told.later(days=2).card().kind is Kind.GONE


@pytest.mark.parametrize(
    ("off_min", "said"), [(61, "Its clock is 61 min ahead of ours."), (-90, "Its clock is 1 h 30 min behind ours.")]
)
def test_with_a_clock_that_is_off_times_are_shown_by_ours(off_min, said):
    off = timedelta(minutes=off_min)
    told = (
        Told().online(at=NOW + off).state(ends=NOW + off + timedelta(hours=2), started=NOW + off - timedelta(hours=2))
    )
    card = told.asks(at=NOW + off).card()
    assert (card.ends, card.since, card.done) == (NOW + timedelta(hours=2), NOW, 0.5)
    assert words(told).clock == said


def test_a_clock_that_is_right_is_not_mentioned():
    told = Told().online(at=NOW + timedelta(seconds=20)).state()
    assert words(told).clock == ""
    assert told.card().ends == NOW + timedelta(minutes=90)


def test_the_end_is_by_the_clock_of_the_bench_and_names_its_zone_where_the_page_has_another():
    told = Told().online().state(zone="Asia/Shanghai", ends=NOW + timedelta(hours=5))
    assert words(told).ends == "ends about 01:00 tomorrow CST"
    assert words(told, "Asia/Shanghai").ends == "ends about 01:00 tomorrow"
    assert words(told.later(hours=6)).ends == "was to end about 01:00 CST"
    with language("zh"):
        assert words(told).ends == "原定约 01:00 CST 结束"
        assert words(told.state(ends=told.now + timedelta(hours=24))).ends == "约 明天 19:00 结束"


def test_a_sentence_is_that_of_the_station_in_the_language_of_the_reader():
    told = Told().online().state(sentence="Soaking at −40 °C", sentences={"zh": "在 −40 °C 恒温"})
    assert words(told).sentence == "Soaking at −40 °C"
    with language("zh"):
        assert words(told).sentence == "在 −40 °C 恒温"


def test_names_of_a_station_are_text():
    told = Told().online().state(sentence="<script>alert(1)</script>")
    assert words(told).sentence == "&lt;script&gt;alert(1)&lt;/script&gt;"


def test_a_bench_by_hand_has_only_alarms_and_results():
    card = Told().online().alarm(1, bench="~other").card()
    assert (card.title, card.kind, card.has_state) == ("~other", Kind.IDLE, False)


def test_stations_with_the_same_title_are_told_apart():
    told = Told().online("lab1").state("a", "lab1").online("lab%232").state("a", "lab%232").online("c", title="Other")
    told.state("a", "c").online("d", title="").state("a", "d")
    titles = {card.station_title for card in told.cards()}
    assert titles == {"Laboratory (lab1)", "Laboratory (lab#2)", "Other", "d"}
