"""What is kept of the messages of all stations, whoever has sent them."""

import json
import sys
from datetime import timedelta

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.overview import fold
from bench.overview.cards import Kind, cards_of
from bench.overview.facts import clean, facts_of, is_address
from bench.overview.fold import Overview
from bench.station.mqtt.messages import Alarm, Questions, Results, State, Status
from tests.support.overview import NOW, Told

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=10,
)
KEYS = sorted({key for model in (Status, State, Questions, Alarm, Results) for key in model.model_fields})
KINDS = ("state", "questions", "alarms", "results", "readings/chamber.process_value", "readings/x", "commands/anna")
LEVELS = st.sampled_from(["lab", "a", "~b", "%00", "commands", "+", "#", "x" * 200]) | st.text(max_size=5)


@given(
    st.lists(
        st.tuples(
            LEVELS,
            LEVELS,
            st.sampled_from(KINDS),
            st.dictionaries(st.sampled_from(KEYS), JSON, max_size=12).map(lambda each: json.dumps(each).encode())
            | st.binary(max_size=40)
            | JSON.map(lambda each: json.dumps(each).encode()),
            st.booleans(),
        ),
        max_size=12,
    )
)
def test_no_message_is_an_error_and_every_card_is_of_bounded_length(messages):
    overview = Overview()
    overview.subscribed(NOW)
    for station, bench, kind, payload, retained in messages:
        for topic in (f"bench/{station}/{bench}/{kind}", f"bench/{station}/status"):
            overview.take(topic, payload, NOW, retained=retained)
    for card in cards_of(overview, NOW + timedelta(seconds=1)):
        assert len(repr(card)) < 20_000
    overview.subscribed(NOW)
    overview.settled()
    assert [card.has_state for card in cards_of(overview, NOW)].count(True) == 0, "nothing came again"


def test_a_state_is_read_whole():
    told = Told().online().state(units=("QF-1", "QF-2"), sentence="Soaking", sentences={"zh": "恒温", "xx": "?"})
    card = told.card()
    assert (card.kind, card.title, card.station_title) == (Kind.RUNNING, "Bench a", "Laboratory")
    assert (card.units, card.sentence, card.sentences) == (("QF-1", "QF-2"), "Soaking", (("zh", "恒温"),))
    assert (card.done, card.step, card.zone) == (0.25, (2, 4), "Europe/Berlin")
    assert card.has_unread is False


def test_ten_thousand_topics_are_bounded_and_said_to_be_more():
    told = Told()
    for number in range(100):
        told.online(f"lab{number}").state("a", f"lab{number}")
    for number in range(10_000):
        told.state("a", f"hostile{number}", title="x" * 10_000)
        told.tell(f"lab0/{number}/alarms", b'{"text": "x"}')
        told.tell(f"lab0/a/readings/{number}.process_value", b'{"value": 1, "unit": "\xc2\xb0C"}')
    overview = told.overview
    assert len(overview.stations) == fold.MOST_STATIONS
    assert all(name.startswith("lab") for name in overview.stations)
    assert len(overview.stations["lab0"].benches) == fold.MOST_BENCHES
    assert len(overview.stations["lab0"].benches["a"].readings) == 2 * fold.MOST_TEMPERATURES
    assert overview.refused >= 10_000


def test_a_station_that_is_online_takes_the_place_of_one_that_is_not():
    told = Told()
    for number in range(fold.MOST_STATIONS):
        told.state("a", f"hostile{number}")
    told.online("lab").state()
    assert "lab" in told.overview.stations
    assert len(told.overview.stations) == fold.MOST_STATIONS
    for number in range(fold.MOST_STATIONS, 2 * fold.MOST_STATIONS):
        told.state("a", f"hostile{number}")
    assert "lab" in told.overview.stations


@pytest.mark.parametrize(
    "payload",
    [
        b"[" * 100_000, b"\xff\xfe", b"null", b'"state"', b"[]", b"{", b'{"title": ' + b"9" * 5000 + b"}",
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_said_and_what_was_known_stays(payload):
    told = Told().online().state()
    assert told.tell("lab/a/state", payload).card().has_unread
    assert told.card().title == "Bench a"
    told.overview.subscribed(NOW, again=True)
    assert told.state().card().has_unread is False


def test_messages_of_another_version_are_read_as_far_as_they_can_be():
    told = Told().online(version="99.0")
    found = {
        "title": "Left",
        "run": "r",
        "ends": {"at": 1},
        "units": "QF-1",
        "done": "many",
        "new_key": [1],
        "total": True,
    }
    card = told.tell("lab/a/state", json.dumps(found).encode()).card()
    assert (card.title, card.kind, card.ends, card.units, card.version) == ("Left", Kind.RUNNING, None, (), "99.0")
    assert card.has_unread
    assert Told().online().tell("lab/a/state", b'{"run": "r"}').card().title == "a"


@pytest.mark.parametrize(
    "ends",
    ["2026-11-27T13:00:00", "9999-12-31T23:59:59+00:00", "0001-01-01T00:00:00+14:00", "tomorrow", "1e9", "\ud800"],
)
def test_an_instant_without_a_zone_or_far_away_is_none(ends):
    told = Told().online().tell("lab/a/state", json.dumps({"run": "r", "ends": ends}).encode())
    assert told.card().ends is None


def test_the_time_zone_of_a_message_is_no_path():
    for zone in ("../../etc/passwd", "/etc/localtime", "America", "posixrules\x00", "Nowhere/City"):
        assert Told().online().state(zone=zone).card().zone == ""


@pytest.mark.parametrize(
    "url",
    [
        "javascript:alert(1)", "data:text/html,x", "//evil.example", "http://user@evil.example/", "https:///x", "http://",
        'http://a"onclick="x', "http://a/\nb", "http://[", "http://a:99999/", "ftp://a/", "http://a/" + "x" * 300,
        "http://ｅvil.example/", "http://a\\@b/", " http://a/",
    ],
)  # fmt: skip
def test_only_an_address_of_the_web_becomes_a_link(url):
    assert not is_address(url)
    assert Told().online().state(url=url).card().url == ""


def test_an_address_of_a_station_stays():
    for url in ("http://lab.example.org:8421/benches/a", "https://[2001:db8::1]:8421/benches/~%2523"):
        assert Told().online().state(url=url).card().url == url


def test_texts_have_no_control_characters_and_no_marks_of_direction():
    assert clean("a\x00b\n\u202ec\u2066 d\ud800") == "a b c d"
    assert clean("<b>&") == "<b>&"
    assert len(clean("x" * 1000)) == 200
    card = Told().online().state(title="\u202eevil", units=tuple(f"u{n}" for n in range(1000))).card()
    assert card.title == "evil"
    assert len(card.units) == 8


def test_numbers_are_finite_and_bounded():
    told = Told().online().tell("lab/a/state", b'{"run": "r", "done": 1e999, "total": -5, "waiting": 99999999999}')
    assert told.card().step == (0, 0)
    assert told.card().waiting == 10**9
    assert told.tell("lab/a/readings/chamber.process_value", b'{"value": NaN, "unit": "\xc2\xb0C"}')
    assert told.card().temperatures[0].value is None
    assert facts_of(b'{"value": 1' + b"0" * 400 + b"}").number("value") is None


def test_alarms_and_results_are_the_newest_and_one_that_is_sent_again_counts_once():
    told = Told().online().state()
    for number in range(20):
        told.alarm(number).result(f"run{number}")
    told.alarm(19).result("run19", "FAIL")
    card = told.card()
    assert [each.text for each in card.alarms] == ["no 19", "no 18", "no 17", "no 16", "no 15"]
    assert [each.verdict for each in card.results] == ["FAIL", "PASS", "PASS", "PASS", "PASS"]


def test_only_temperatures_of_chambers_are_kept():
    told = (
        Told().online().state().reading(20.0, "head.angle", "°").reading(-39.5).reading(1.0, "oven.process_value", "K")
    )
    told.reading(-40.0, "chamber.set_point")
    (found,) = told.card().temperatures
    assert (found.name, found.value, found.set_point, found.old_min) == ("chamber", -39.5, -40.0, 0)
    assert told.later(minutes=2).card().temperatures[0].old_min == 2
    assert Told().online().reading(20.0).cards() == [], "a reading alone is no bench"


def test_commands_and_replies_are_no_benches():
    told = Told().online().tell("lab/commands/state", b"{}").tell("lab/replies/state", b"{}")
    assert told.cards() == []


@pytest.mark.slow
def test_the_memory_of_a_flood_is_small():
    told = Told()
    long = "\U0001f600" * 100_000
    for number in range(60):
        told.online(f"lab{number}").state(
            "a", f"lab{number}", title=long, sentence=long, problems=(long,) * 50, url=long
        )
        told.tell(f"lab{number}/a/alarms", json.dumps({"text": long}).encode())
    size = sum(sys.getsizeof(each) for card in told.cards() for each in (card.title, *card.problems, card.sentence))
    assert size < 60 * 20_000
