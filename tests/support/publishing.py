"""Stations whose benches are made up, and whose messages are those of the real publisher.

As a program it publishes for several stations until its standard input ends; killed, it leaves their last wills.
"""

from __future__ import annotations

import asyncio
import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any

from bench.clock import Stopwatch, wall_utc
from bench.station.mqtt.publisher import Publisher
from bench.station.mqtt.settings import MqttSettings
from bench.station.mqtt.shown import About, Show
from bench.station.mqtt.start import Start
from bench.station.view import BenchView, QuestionView, ReadingView, RunView, StationView
from tests.support.runs import ROOT

SENTENCES = {"en": "Soaking at −40 °C", "zh": "在 −40 °C 恒温"}
KINDS = ("running", "idle", "asks", "paused", "alarm")


def run_view(of: dict[str, Any], passed_s: float) -> RunView:
    """Return the run of a bench that is made up: its kind and the minutes until its end."""
    now, number = wall_utc(), of["number"]
    asks = [QuestionView(step="ask", text=of.get("text", "Turn the unit over."), expected="done")]
    readings = [
        ReadingView(name="chamber.process_value", quality="valid", value=-40 + passed_s / 10 % 1, unit="°C", age_s=0.1),
        ReadingView(name="chamber.set_point", quality="valid", value=-40.0, unit="°C", age_s=0.1),
        ReadingView(name="head.angle", quality="valid", value=90.0, unit="°", age_s=0.1),
    ]
    return RunView(
        run=f"20261127T08{number:02}00Z_tumble_QF-{number:04}", title=of.get("run_title", "Static temperature tumble"),
        sequence="tumble_static", bench=of["title"], units=[f"QF-{number:04}"], operator="A. Technician",
        started=now - timedelta(minutes=90), item="", steps=["soak"], done=118, total=412, now_s=10.0 + passed_s,
        speed=1.0, ends=now + timedelta(minutes=of.get("ends_min", 60)),
        held_by=["operator"] if of["kind"] == "paused" else [], questions=asks if of["kind"] == "asks" else [],
        readings=readings, last_event=1,
        problems=["chamber: does not follow its set point"] if of["kind"] == "alarm" else [],
    )  # fmt: skip


def station_view(of: dict[str, Any], passed_s: float) -> StationView:
    """Return the view of a station."""
    benches = [
        BenchView(
            name=each["name"], title=each["title"], stopped=each.get("stopped", ""), waiting=[],
            running=[] if each["kind"] == "idle" else [run_view(each, passed_s)],
        )
        for each in of["benches"]
    ]  # fmt: skip
    return StationView(title=of["title"], now=wall_utc(), benches=benches, problems=[], other_runs=[])


async def published(of: dict[str, Any]) -> None:
    """Publish for a station, as its parts do: a view each second, shown and sent by the real code."""
    settings = MqttSettings.model_validate(of["mqtt"])
    folder = Path(of["folder"])
    start = Start(settings, folder, folder / "runs", of["title"], "1.0", {})
    about = {each["name"]: About(each.get("zone", "Europe/Berlin"), each["title"]) for each in of["benches"]}
    show = Show(settings, "1.0", about, lambda _: SENTENCES)
    publisher, watch = Publisher(start), Stopwatch()
    working = asyncio.create_task(publisher.work())
    while not working.done():
        shown = show.of(station_view(of, watch.elapsed_s()), {}, of.get("url", ""))
        publisher.take(shown._asdict())
        await asyncio.sleep(1.0)
    working.result()


async def main() -> None:
    """Publish for the stations of the first line of standard input."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    stations = json.loads(await asyncio.to_thread(sys.stdin.readline))
    working = [asyncio.create_task(published(each)) for each in stations]
    ended = asyncio.create_task(asyncio.to_thread(sys.stdin.read))
    await asyncio.wait([*working, ended], return_when=asyncio.FIRST_COMPLETED)
    for each in working:
        each.cancel()
    await asyncio.gather(*working, return_exceptions=True)


class Publishing:
    """Process that publishes for stations."""

    def __init__(self, stations: list[dict[str, Any]]) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.support.publishing"], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL,
            text=True, cwd=ROOT,
        )  # fmt: skip
        assert self.process.stdin is not None
        self.process.stdin.write(f"{json.dumps(stations)}\n")
        self.process.stdin.flush()

    def kill(self) -> None:
        """Kill it, so that the broker publishes the last wills."""
        self.process.kill()
        self.process.wait(10)

    def end(self) -> None:
        """Let its stations say that they end."""
        if self.process.poll() is None:
            self.process.communicate(timeout=20)
        if self.process.stdin is not None:
            self.process.stdin.close()


@contextmanager
def publishing(stations: list[dict[str, Any]]) -> Iterator[Publishing]:
    """Publish for stations until the block ends."""
    made = Publishing(stations)
    try:
        yield made
    finally:
        made.end()


def station_of(folder: Path, port: int, number: int, kind: str = "running", **more: Any) -> dict[str, Any]:
    """Return a station with a bench that is made up."""
    own = folder / f"station{number}"
    own.mkdir(parents=True, exist_ok=True)
    bench = {"name": "a", "title": f"Bench {number:02}", "kind": kind, "number": number, **more}
    mqtt = {"host": "127.0.0.1", "port": port, "station": f"lab{number}"}
    return {
        "title": f"Laboratory {number}", "folder": str(own), "mqtt": mqtt, "benches": [bench],
        "url": f"http://lab{number}.example.org:8421/",
    }  # fmt: skip


if __name__ == "__main__":
    asyncio.run(main())
