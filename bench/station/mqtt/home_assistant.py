"""Announcement of a bench to Home Assistant: its discovery of devices, one retained message for each bench."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

from bench.station.mqtt.topics import Topics
from bench.station.view import BenchView

SITE = "https://www.home-assistant.io/integrations/mqtt/"  # keys: "Device discovery payload"
_CLASSES = {
    "°C": "temperature", "K": "temperature", "V": "voltage", "mV": "voltage", "A": "current", "mA": "current",
    "W": "power", "Hz": "frequency", "Pa": "pressure", "hPa": "pressure", "s": "duration",
}  # fmt: skip


def announcement(bench: BenchView, channels: Mapping[str, str], topics: Topics, version: str) -> tuple[str, str]:
    """Return topic and message; `channels` are units of the channels that were read so far, by name."""
    device = f"bench_{topics.station}_{bench.name}"
    state = topics.of_bench(bench.name, "state")
    sensors: dict[str, dict[str, Any]] = {
        "run": _sensor(device, "run", "Run", state, "{{ value_json.run_title or 'none' }}"),
        "ends": _sensor(device, "ends", "End", state, "{{ value_json.ends }}", device_class="timestamp"),
        "done": _sensor(device, "done", "Steps that have ended", state, "{{ value_json.done }}"),
    }
    for name, unit in channels.items():
        topic = topics.reading(bench.name, name)
        key = f"reading_{_plain(name)}"
        about = {"unit_of_measurement": unit, "state_class": "measurement"} if unit else {}
        if unit in _CLASSES:
            about["device_class"] = _CLASSES[unit]
        sensors[key] = _sensor(device, key, name, topic, "{{ value_json.value }}", expire_after=60, **about)
    message = {
        "device": {
            "identifiers": [device], "name": bench.title, "manufacturer": "inertial-test-bench", "sw_version": version
        },
        "origin": {"name": "inertial-test-bench", "sw_version": version},
        "availability": [{"topic": topics.status, "value_template": "{{ value_json.status }}"}],
        "components": sensors,
    }  # fmt: skip
    return f"homeassistant/device/{device}/config", json.dumps(message, ensure_ascii=False)


def _sensor(device: str, key: str, name: str, topic: str, template: str, **more: Any) -> dict[str, Any]:
    return {
        "platform": "sensor", "unique_id": f"{device}_{key}", "name": name, "state_topic": topic,
        "value_template": template, **more,
    }  # fmt: skip


def _plain(name: str) -> str:
    """Return a name of letters, digits and underscores, different for different names."""
    return "".join(each if re.fullmatch("[a-z0-9]", each) else f"_{ord(each):x}_" for each in name)
