"""MQTT: topics for any name, what is shown and how often, settings, commands, Home Assistant."""

import asyncio
import json
import shutil
from datetime import UTC, datetime, timedelta
from uuid import uuid4

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.clock import wall_utc
from bench.errors import InputError
from bench.station.mqtt import shown
from bench.station.mqtt.connection import LONGEST_WAIT_S, Backoff
from bench.station.mqtt.home_assistant import announcement
from bench.station.mqtt.orders import Orders
from bench.station.mqtt.settings import MqttSettings
from bench.station.mqtt.shown import About, Show
from bench.station.mqtt.topics import LONGEST, Topics, bench_of_file, level
from bench.station.runs.catalogue import Catalogue
from bench.station.settings import read_station
from bench.station.storage.audit import Audit
from bench.station.storage.database import Database
from bench.station.view import BenchView, QuestionView, ReadingView, RunView, StationView
from tests.support.how_to import FOLDER, blocks
from tests.support.runs import ROOT

NOW = datetime(2026, 11, 21, 20, 0, tzinfo=UTC)
NAMES = st.text(st.characters(), max_size=300)


@given(NAMES)
def test_a_level_has_no_wildcard_no_separator_and_no_control_character(name):
    text = level(name)
    assert text.encode("utf-8")
    assert not set("+#/\x00\x1f\x7f\x9f") & set(text)
    assert not any(ord(each) < 32 for each in text)
    assert not text.startswith("$")
    assert 0 < len(text) <= LONGEST + 18


@given(NAMES, NAMES)
def test_different_names_have_different_levels(one, other):
    assert (level(one) == level(other)) == (one == other)


def test_plain_names_stay_and_others_are_encoded():
    assert level("chamber.process_value") == "chamber.process_value"
    assert level("温度") == "温度"
    assert level("$SYS/#+%\n") == "%24SYS%2F%23%2B%25%0A"
    assert level("a" * 200) != level("a" * 201)
    assert bench_of_file("/x/left.yaml", {"/x/left.yaml": "a"}) == "a"
    assert bench_of_file("/x/../#.yaml", {}) == "~#"
    assert Topics("lab3").of_bench("~#", "events") == "bench/lab3/~%23/events"


# What is shown


def run_view(**more):
    common = {
        "run": "r", "title": "T", "sequence": "s", "bench": "b", "units": [], "operator": "", "started": NOW,
        "item": "", "steps": ["a"], "done": 1, "total": 3, "now_s": 10.0, "speed": 1.0, "ends": NOW, "held_by": [],
        "questions": [], "readings": [], "problems": [], "last_event": 1,
    }  # fmt: skip
    return RunView.model_validate({**common, **more})


def view(*runs):
    bench = BenchView(name="left", title="Left", stopped="", running=list(runs), waiting=[])
    return StationView(title="S", now=NOW, benches=[bench], problems=[], other_runs=[])


def show(**more):
    return Show(MqttSettings.model_validate({"host": "localhost", "station": "lab3", **more}), "1")


def test_a_bench_without_a_run_has_a_state_and_no_question():
    shown = show().of(view(), {})
    assert json.loads(shown.retained["bench/lab3/left/state"])["run"] == ""
    assert shown.retained["bench/lab3/left/questions"] == ""
    assert shown.readings == {}


def test_a_question_is_retained_while_it_is_open():
    made = show()
    topic = "bench/lab3/left/questions"
    asking = run_view(questions=[QuestionView(step="a", text="Turn it.", expected="done")])
    assert json.loads(made.of(view(asking), {}).retained[topic])["questions"][0]["text"] == "Turn it."
    assert made.of(view(run_view()), {}).retained[topic] == ""


def state_of(made, view_, address=""):
    return json.loads(made.of(view_, {}, address).retained["bench/lab3/left/state"])


def test_a_state_says_what_a_page_of_all_benches_needs():
    about = {"left": About("Asia/Shanghai", "Bench of the record")}
    settings = MqttSettings.model_validate({"host": "localhost", "station": "lab3"})
    made = Show(settings, "1", about, lambda run: {"en": f"Soaking in {run}", "zh": "恒温"})
    state = state_of(made, view(run_view()), "https://lab3.example.org:8421/")
    assert (state["zone"], state["bench"]) == ("Asia/Shanghai", "Bench of the record")
    assert state["url"] == "https://lab3.example.org:8421/benches/left"
    assert (state["sentence"], state["sentences"]) == ("Soaking in r", {"zh": "恒温"})
    assert datetime.fromisoformat(state["started"]) == NOW
    idle = state_of(made, view())
    assert (idle["url"], idle["sentence"], idle["zone"]) == ("", "", "Asia/Shanghai")


def test_a_state_that_stays_is_sent_again_each_hour_and_questions_keep_their_instant():
    made, asking = show(), [QuestionView(step="a", text="Turn it.", expected="done")]

    def sent(minutes, **more):
        seen = view(run_view(questions=asking, **more)).model_copy(update={"now": NOW + timedelta(minutes=minutes)})
        retained = made.of(seen, {}).retained
        return [
            (datetime.fromisoformat(json.loads(retained[f"bench/lab3/left/{kind}"])["at"]) - NOW).total_seconds() / 60
            for kind in ("state", "questions")
        ]

    assert sent(0) == [0, 0]
    assert sent(59) == [0, 0]
    assert sent(60) == [60, 0]
    assert sent(61, done=2) == [61, 0]


def test_an_end_that_moves_by_seconds_is_not_sent_again():
    made = show()

    def ends(seconds):
        retained = made.of(view(run_view(ends=NOW + timedelta(seconds=seconds))), {}).retained
        return json.loads(retained["bench/lab3/left/state"])["ends"]

    first = ends(0)
    assert ends(29) == ends(-29) == first
    assert ends(31) != first


def test_readings_are_decimated_and_carry_bench_time_and_instant(monkeypatch):
    now = [0.0]

    class At:
        def __init__(self):
            self.begun_s = now[0]

        def elapsed_s(self):
            return now[0] - self.begun_s

    monkeypatch.setattr(shown, "Stopwatch", At)
    made = show(readings_every="0.2 s")
    topic = "bench/lab3/left/readings/head.angle"

    def read(age_s, quality="valid", value=1.5):
        reading = ReadingView(name="head.angle", quality=quality, value=value, unit="°", age_s=age_s)
        return made.of(view(run_view(readings=[reading])), {"r": (NOW, 2.0)}).readings

    first = json.loads(read(0.5)[topic])
    assert (first["value"], first["unit"], first["quality"], first["at_s"]) == (1.5, "°", "valid", 9.5)
    assert datetime.fromisoformat(first["at"]) == NOW + timedelta(seconds=7.5)
    sent = []
    for now[0] in (0.1, 0.19, 0.2, 0.3, 0.39, 0.41, 0.5):
        sent += [now[0] for _ in read(now[0])]
    assert sent == [0.2, 0.41]
    stale = show().of(view(run_view(readings=[ReadingView(name="x", quality="stale", why="silent")])), {}).readings
    assert json.loads(stale["bench/lab3/left/readings/x"])["value"] is None


# Keys of https://www.home-assistant.io/integrations/mqtt/ ("Device discovery payload") and …/sensor.mqtt/
OF_MESSAGE = {"device", "origin", "components", "availability", "availability_mode", "state_topic", "qos", "encoding"}
OF_DEVICE = {
    "configuration_url", "connections", "hw_version", "identifiers", "manufacturer", "model", "model_id", "name",
    "serial_number", "suggested_area", "sw_version", "via_device",
}  # fmt: skip
OF_SENSOR = {
    "platform", "availability", "availability_mode", "availability_template", "availability_topic", "device",
    "device_class", "enabled_by_default", "encoding", "entity_category", "expire_after", "force_update", "icon",
    "json_attributes_template", "json_attributes_topic", "last_reset_value_template", "name", "object_id", "options",
    "payload_available", "payload_not_available", "qos", "state_class", "state_topic", "suggested_display_precision",
    "unique_id", "unit_of_measurement", "value_template",
}  # fmt: skip
UNITS = {"temperature": {"°C", "°F", "K"}, "voltage": {"V", "mV"}, "current": {"A", "mA"}, "frequency": {"Hz"}}


def test_an_announcement_has_the_keys_that_home_assistant_documents():
    channels = {"chamber.process_value": "°C", "counter.x": "pulse/s", "supply.voltage": "V", "A b/+": ""}
    topic, payload = announcement(view().benches[0], channels, Topics("lab3"), "1")
    found = json.loads(payload)
    assert topic == "homeassistant/device/bench_lab3_left/config"
    assert found.keys() <= OF_MESSAGE
    assert found["device"].keys() <= OF_DEVICE
    assert found["origin"].keys() <= {"name", "sw_version", "support_url"}
    assert found["availability"] == [{"topic": "bench/lab3/status", "value_template": "{{ value_json.status }}"}]
    sensors = found["components"].values()
    assert all(each.keys() <= OF_SENSOR and each["platform"] == "sensor" for each in sensors)
    assert len({each["unique_id"] for each in sensors}) == len(sensors) == 3 + len(channels)
    assert all(
        each["unit_of_measurement"] in UNITS[each["device_class"]]
        for each in sensors
        if each.get("device_class") in UNITS
    )
    by_name = {each["name"]: each for each in sensors}
    assert by_name["chamber.process_value"]["device_class"] == "temperature"
    assert by_name["counter.x"]["unit_of_measurement"] == "pulse/s"
    assert "device_class" not in by_name["counter.x"]
    assert by_name["A b/+"]["state_topic"] == "bench/lab3/left/readings/A b%2F%2B"


# Settings

STATION = "schema: itb-station/1\nbenches: {a: {file: simulated}}\nmqtt: {host: HOST, station: lab3, MORE}\n"


def read(tmp_path, more, host="127.0.0.1"):
    (tmp_path / "station.yaml").write_text(STATION.replace("HOST", host).replace("MORE", more))
    return read_station(tmp_path / "station.yaml", tmp_path / "own").mqtt


def test_the_settings_of_the_page_are_right(tmp_path):
    (text,) = (yaml for _, yaml in blocks(FOLDER / "station.md") if "mqtt:" in yaml)
    shutil.copytree(ROOT / "config", tmp_path / "config")
    (tmp_path / "station.yaml").write_text(text, "utf-8")
    found = read_station(tmp_path / "station.yaml", tmp_path / "own").mqtt
    assert (found.host, found.port_used, found.command_users) == ("broker.example.org", 8883, ())


def test_a_port_follows_from_tls_and_files_are_beside_the_settings(tmp_path):
    (tmp_path / "secret").write_text("x")
    (tmp_path / "secret").chmod(0o600)
    assert read(tmp_path, "user: x").port_used == 1883
    found = read(tmp_path, "tls: {}, password_file: secret, commands: {users: [anna]}", "broker.lab")
    assert found.port_used == 8883
    assert found.password_file == str(tmp_path / "secret")
    assert found.command_users == ()
    assert read(tmp_path, "commands: {enabled: true, users: [anna]}").command_users == ("anna",)


@pytest.mark.parametrize(
    ("more", "host", "message"),
    [
        ("password_file: open", "localhost", "chmod 600"),
        ("password_file: none", "localhost", "cannot be read"),
        ("password_file: open", "broker.lab", "add tls"),
        ("tls: {key: open}", "localhost", "belong together"),
        ("tls: {key: open, certificate: open}", "localhost", "chmod 600"),
        ("tls: {verify: false}", "localhost", "verify"),
        ("commands: {enabled: true, users: ['#']}", "localhost", "should match"),
        ("readings_every: 1 ms", "localhost", "readings_every"),
    ],
)
def test_unsafe_settings_are_refused(tmp_path, more, host, message):
    (tmp_path / "open").write_text("x")
    (tmp_path / "open").chmod(0o644)
    with pytest.raises(InputError, match=message):
        read(tmp_path, more, host)


def test_waits_between_attempts_double_up_to_a_minute_and_differ():
    backoff = Backoff()
    waits = [backoff.next_s() for _ in range(20)]
    longest = [min(2.0**number, LONGEST_WAIT_S) for number in range(20)]
    assert all(most / 2 <= wait <= most for wait, most in zip(waits, longest, strict=True))
    assert len(set(waits[6:])) > 1
    backoff.reset()
    assert backoff.next_s() <= 1.0


# Commands


def command(name="abort", **more):
    return {"command": name, "run": "none", "nonce": uuid4().hex, "at": wall_utc().isoformat(), **more}


def test_commands_that_are_not_obeyed_are_answered_and_audited(tmp_path):
    database = Database(tmp_path)
    orders = Orders(database, Catalogue(tmp_path), ("anna",))

    def reply(content, user="anna", *, retained=False):
        return asyncio.run(orders.obey(user, json.dumps(content), retained=retained))

    once = command()
    cases = [
        (once, "there is no run"), (once, "repeated"),
        (command(at=(wall_utc() - timedelta(seconds=31)).isoformat()), "valid for 30 s"),
        (command(at=(wall_utc() + timedelta(seconds=31)).isoformat()), "valid for 30 s"),
        (command(at="2026-11-21T20:00:00"), "time zone"), (command("start"), "not valid"),
        (command("resume"), "not valid"), (command(run="../x"), "no run"), (command(also=1), "not valid"),
        ([], "not valid"),
    ]  # fmt: skip
    for content, words in cases:
        found = reply(content)
        assert (found.done, words in found.text) == (False, True), found
    assert "retained" in reply(command(), retained=True).text
    assert "may not" in reply(command(), "eve").text
    assert reply(once).nonce == once["nonce"]
    entries = list(Audit(database).entries())
    assert len(entries) == len(cases) + 3
    assert {(each["how"], each["action"]) for each in entries} == {("mqtt", "command refused")}
    with database.transaction() as tables:
        tables.execute("DROP TABLE mqtt_nonce")  # as if the disk had failed
    assert "no run" in reply(command("abort")).text
    assert "cannot be written" in reply(command("pause")).text
    database.close()
