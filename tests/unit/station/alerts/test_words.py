"""Texts of alerts: in both languages, each on three lines whatever the values are; addresses never shown."""

import re
import shutil
import string

import pytest

from bench.errors import InputError
from bench.station.alerts.kinds import Kind
from bench.station.alerts.send import masked
from bench.station.alerts.settings import AlertsEntry, read_alerts
from bench.station.alerts.words import _REMARKS, _TEXTS, LANGUAGES, TITLE_LIMIT, Remarks, message
from bench.station.settings import read_station
from tests.support.how_to import FOLDER, STATION, blocks
from tests.support.runs import ROOT


def places(text):
    return {name for _, name, _, _ in string.Formatter().parse(text) if name}


@pytest.mark.parametrize("catalogue", [_TEXTS, _REMARKS])
def test_both_languages_have_the_same_texts_with_the_same_places(catalogue):
    assert set(catalogue) == set(LANGUAGES)
    shapes = [{key: places("".join(text)) for key, text in catalogue[each].items()} for each in LANGUAGES]
    assert shapes[0] == shapes[1]


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("text", _TEXTS["en"])
def test_a_message_has_three_lines_whatever_its_values_are(text, language):
    hostile = "x\r\nBcc: all@example.org\x1b[31m\u2028{bench}\x00" * 100
    names = places("".join(_TEXTS[language][text]))
    found = message(
        hostile, text, dict.fromkeys(names, hostile), "http://b/", language, Remarks(3, True, True, "phone")
    )
    assert len(found.body.splitlines()) == 3
    assert len(found.body) < 2000
    assert len(found.title) <= TITLE_LIMIT
    assert (found.title + found.body.replace("\n", "")).isprintable()


def test_a_message_says_what_happened_what_to_do_and_where():
    values = {"bench": "a", "title": "Smoke", "verdict": "PASS"}
    found = message("Lab 3", "end", values, "http://b/runs/r1", "en", Remarks(historical=True))
    assert found.title == "Lab 3: a: Smoke has ended: PASS (while the station was down)"
    assert found.body.splitlines()[1:] == ["Read the report; the bench is free.", "http://b/runs/r1"]


ADDRESSES = {
    "mailtos://anna:p4ss%40word@mail.example.org?to=boris@example.org": ("p4ss%40word", "p4ss@word"),
    "tgram://123456789:AAEsecret/987654321/": ("AAEsecret", "123456789"),
    "slack://T1JJ3T3L2/A1BRTD4JD/TIiajkdnlazkcOXrIdevi7FQ/#general": (
        "T1JJ3T3L2",
        "A1BRTD4JD",
        "TIiajkdnlazkcOXrIdevi7FQ",
    ),
    "json://127.0.0.1:8080/hook/s3cret-token?key=abcdef": ("s3cret-token", "abcdef"),
}


@pytest.mark.parametrize(("url", "secrets"), ADDRESSES.items())
def test_a_problem_shows_no_secret_of_an_address(url, secrets):
    found = masked(f"cannot send to {url}\r\n({' or '.join(secrets)})", url)
    assert found.startswith("cannot send to *** (***")
    assert [secret for secret in secrets if secret in found] == []


ADDRESS = next(iter(ADDRESSES))


def addresses(tmp_path, text, mode=0o600):
    path = tmp_path / "addresses.yaml"
    path.write_text(text)
    path.chmod(mode)
    return AlertsEntry.model_validate({"addresses": "addresses.yaml", "routes": {"phone": {}}})


def test_addresses_are_read_from_a_private_file_and_not_shown(tmp_path):
    found = read_alerts(addresses(tmp_path, f"phone: {ADDRESS}\n"), tmp_path, ["a"])
    assert "p4ss" not in f"{found!r} {found}"
    assert "***" in repr(found)
    assert found.routes["phone"].url.get_secret_value() == ADDRESS


@pytest.mark.parametrize(
    ("text", "mode", "words"),
    [
        ("phone: json://p4ss@host\n", 0o640, "chmod 600"),
        ("phone: json://p4ss@host\n", 0o604, "chmod 600"),
        ("phone: p4ss\n", 0o600, "expected one line"),
        ("phone: [p4ss, p4ss]\n", 0o600, "expected one line"),
        ("p4ss\n", 0o600, "expected one line"),
        ("other: json://p4ss@host\n", 0o600, "no address of phone"),
        ("phone: json://p4ss@host\njson://p4ss: json://p4ss@host\n", 0o600, "no route of the settings"),
        ("phone: [p4ss\n", 0o600, r"addresses.yaml:1"),
    ],
)
def test_a_file_of_addresses_is_refused_without_showing_it(tmp_path, text, mode, words):
    with pytest.raises(InputError, match=words) as problem:
        read_alerts(addresses(tmp_path, text, mode), tmp_path, ["a"])
    assert "p4ss" not in str(problem.value)


def test_the_settings_of_the_page_are_read(tmp_path):
    page = FOLDER / "alerts.md"
    (text,) = (yaml for _, yaml in blocks(page) if yaml.startswith(STATION))
    (lines,) = re.findall(r"<<'END'\n(.*?)END", page.read_text("utf-8"), re.DOTALL)
    shutil.copytree(ROOT / "config", tmp_path / "config")
    (tmp_path / "station.yaml").write_text(text)
    (tmp_path / "addresses.yaml").write_text(lines)
    (tmp_path / "addresses.yaml").chmod(0o600)
    found = read_station(tmp_path / "station.yaml", tmp_path / "own")
    assert [route.partition("=")[0] for route in found.alert_routes] == ["phone"]
    rows = re.findall(r"^\| (`.*?) \|", page.read_text("utf-8"), re.MULTILINE)
    described = {kind for row in rows for kind in re.findall(r"`([a-z_]+)`", row)}
    assert described == set(Kind)


@pytest.mark.parametrize(
    ("routes", "words"),
    [
        ("{phone: {next: chef}}", "the route after 'phone', 'chef', is none of phone"),
        ("{phone: {events: [end, ende]}}", "ende"),
        ("{}", "routes"),
        ("{phone: {same_person_as: [b]}}", "the station has no bench 'b'; it has a"),
    ],
)
def test_routes_that_lead_nowhere_are_refused(tmp_path, routes, words):
    text = f"benches: {{a: {{file: simulated}}}}\nalerts: {{addresses: x, routes: {routes}}}\n"
    (tmp_path / "station.yaml").write_text(f"{STATION}{text}")
    with pytest.raises(InputError, match=words):
        read_station(tmp_path / "station.yaml", tmp_path)


def test_a_missing_file_of_addresses_is_named(tmp_path):
    entry = AlertsEntry.model_validate({"addresses": "nowhere", "routes": {"phone": {}}})
    with pytest.raises(InputError, match=r"addresses: .*nowhere cannot be read"):
        read_alerts(entry, tmp_path, ["a"])
