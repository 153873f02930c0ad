"""Messages to the view of all benches, as stations send them."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

from bench.overview.cards import Card, cards_of
from bench.overview.fold import Overview
from bench.station.mqtt.messages import Alarm, Question, Questions, Reading, Results, State, Status

NOW = datetime(2026, 11, 27, 12, 0, tzinfo=UTC)


class Told:
    """An overview that is connected since two minutes, and a clock; `tell` sends a message of a station `lab`."""

    def __init__(self) -> None:
        self.overview, self.now = Overview(), NOW
        self.overview.subscribed(NOW - timedelta(minutes=2))

    def later(self, **passed: float) -> Told:
        """Let some time pass."""
        self.now += timedelta(**passed)
        return self

    def tell(self, topic: str, message: Any, *, retained: bool = False) -> Told:
        """Send a message, or bytes, on a topic below that of the station."""
        payload = message if isinstance(message, bytes) else message.payload().encode()
        self.overview.take(f"bench/{topic}", payload, self.now, retained=retained)
        return self

    def online(self, station: str = "lab", *, retained: bool = False, **more: Any) -> Told:
        """Say that a station is online."""
        about = {"status": "online", "bd_seq": 1, "title": "Laboratory", "version": "1.0", "at": self.now}
        return self.tell(f"{station}/status", Status.model_validate({**about, **more}), retained=retained)

    def offline(self, station: str = "lab", *, retained: bool = False, **more: Any) -> Told:
        """Publish the last will of a station."""
        will = Status.model_validate({"status": "offline", "bd_seq": 1, **more})
        return self.tell(f"{station}/status", will, retained=retained)

    def state(self, bench: str = "a", station: str = "lab", *, retained: bool = False, **more: Any) -> Told:
        """Send the state of a bench, by default of one that runs."""
        state = {
            "title": f"Bench {bench}", "run": "r", "run_title": "Smoke test", "at": self.now, "zone": "Europe/Berlin",
            "started": self.now - timedelta(minutes=30), "ends": self.now + timedelta(minutes=90), "done": 1,
            "total": 4,
        }  # fmt: skip
        return self.tell(f"{station}/{bench}/state", State.model_validate({**state, **more}), retained=retained)

    def idle(self, bench: str = "a", **more: Any) -> Told:
        """Send the state of a bench without a run."""
        return self.state(bench, **{"run": "", "run_title": "", "ends": None, "started": None, **more})

    def asks(self, text: str = "Turn it over.", bench: str = "a", **more: Any) -> Told:
        """Ask a question."""
        question = Question(step="s", text=text, expected="done")
        return self.tell(f"lab/{bench}/questions", Questions(run="r", questions=(question,), **more))

    def alarm(self, number: int, text: str = "", bench: str = "a") -> Told:
        """Send an alarm."""
        return self.tell(
            f"lab/{bench}/alarms",
            Alarm(id=f"r:{number}", run="r", seq=number, kind="problem", text=text or f"no {number}", step="", at=NOW),
        )

    def result(self, run: str, verdict: str = "PASS", bench: str = "a") -> Told:
        """Send the end of a run."""
        about: dict[str, Any] = {"title": "Smoke test", "sequence": "smoke", "units": ("QF-1",), "findings": ()}
        ended = Results(id=f"{run}:results", run=run, outcome="completed", verdict=verdict, ended=str(NOW), **about)
        return self.tell(f"lab/{bench}/results", ended)

    def reading(self, value: float | None, channel: str = "chamber.process_value", unit: str = "°C") -> Told:
        """Send a reading."""
        return self.tell(f"lab/a/readings/{channel}", Reading(run="r", value=value, unit=unit, quality="valid"))

    def cards(self) -> list[Card]:
        """Return all cards."""
        return cards_of(self.overview, self.now)

    def card(self) -> Card:
        """Return the only card."""
        (card,) = self.cards()
        return card
