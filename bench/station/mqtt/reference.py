"""Page of the reference on MQTT, made from the models of messages and settings."""

from __future__ import annotations

from typing import NamedTuple

from bench.app.reference.keys import Blocks, keys, table
from bench.station.mqtt.messages import (
    Alarm,
    Command,
    Event,
    Message,
    Questions,
    Reading,
    Reply,
    Results,
    State,
    Status,
)
from bench.station.mqtt.settings import MqttSettings
from bench.station.mqtt.topics import Topics


class Topic(NamedTuple):
    """Documented topic: its pattern, how it is sent, and the model of its messages."""

    pattern: str
    sent: str
    model: type[Message] | type[Command]


_TOPICS = Topics("STATION")
TOPICS = (
    Topic(_TOPICS.status, "QoS 1, retained; last will", Status),
    Topic(_TOPICS.of_bench("BENCH", "state"), "QoS 1, retained", State),
    Topic(_TOPICS.of_bench("BENCH", "questions"), "QoS 1, retained while one is open, then cleared", Questions),
    Topic(_TOPICS.reading("BENCH", "CHANNEL"), "QoS 0, at most once a second unless the settings differ", Reading),
    Topic(_TOPICS.of_bench("BENCH", "events"), "QoS 1; none is lost, those of one run are in order", Event),
    Topic(_TOPICS.of_bench("BENCH", "alarms"), "QoS 1; none is lost", Alarm),
    Topic(_TOPICS.of_bench("BENCH", "results"), "QoS 1; none is lost; at the end of a run", Results),
    Topic(_TOPICS.commands("USER"), "received, if the settings enable commands", Command),
    Topic(_TOPICS.replies("USER"), "QoS 1", Reply),
)
DISCOVERY = "homeassistant/device/bench_STATION_BENCH/config"


def mqtt_page() -> Blocks:
    """Topics and messages by MQTT, and the settings of the connection."""
    rows = [(f"`{each.pattern}`", each.sent, f"[{_name(each)}](#{_name(each)})") for each in TOPICS]
    rows.append((f"`{DISCOVERY}`", "QoS 1, retained, if the settings ask for it", "device discovery of Home Assistant"))
    blocks = [
        "# MQTT",
        "What a [station](../how-to/station.md) publishes to a broker of MQTT 5. Messages are JSON. BENCH is the name "
        "of a bench in `station.yaml`; of a run that was started by hand on another bench file it is `~` and the name "
        "of that file, and only its events, alarms and results are published. In names, the characters `+`, `#`, `/`, "
        "`%`, a `$` at the begin, and control characters are `%` and two hexadecimal digits for each byte. The end of "
        "a name of more than 100 characters is replaced by a hash. Times by the clock of a simulated bench are those "
        "of the simulation.",
        table(("topic", "sent", "message"), rows),
    ]
    for each in TOPICS:
        text = each.model.__doc__ or ""
        blocks += [f"## {_name(each)}", f"`{each.pattern}`: {text}", *keys(each.model, 3)]
    return [*blocks, "## settings", f"Key `mqtt` of `station.yaml`. {MqttSettings.__doc__}", *keys(MqttSettings, 3)]


def _name(topic: Topic) -> str:
    return topic.model.__name__.lower()
