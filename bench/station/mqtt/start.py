"""What the station sends to its publisher first."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

from bench.station.mqtt.settings import MqttSettings


class Start(NamedTuple):
    """What the station sends first: settings, folders, its title and version, and names of benches by bench file."""

    settings: MqttSettings
    folder: Path
    runs: Path
    title: str
    version: str
    benches: dict[str, str]

    def line(self) -> bytes:
        """Return it as a line."""
        found = {**self._asdict(), "settings": self.settings.model_dump(mode="json", exclude_none=True)}
        found["settings"]["readings_every"] = f"{self.settings.readings_every} s"
        return json.dumps(found, default=str).encode() + b"\n"

    @classmethod
    def of_line(cls, line: bytes) -> Start:
        """Return what a line contains."""
        found = json.loads(line)
        settings = MqttSettings.model_validate(found.pop("settings"))
        return cls(settings, Path(found.pop("folder")), Path(found.pop("runs")), **found)
