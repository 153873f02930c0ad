"""Lost frames of a run: a line for each channel, and tables of acquisitions and of gaps."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

from bench.config.models import BenchFile
from bench.metrology.gaps import EVENT
from bench.metrology.missed import Missed
from bench.metrology.run_data import RunData
from bench.sequence.plan.dwells import first_visit
from bench.store.reader import RunReader


@dataclass(frozen=True, slots=True)
class MissedIn:
    """Losses of a channel of a device during an acquisition."""

    step: str
    device: str
    channel: str
    missed: Missed

    def to_json(self) -> dict[str, Any]:
        """JSON content as in the journal of the run."""
        return {
            "step": self.step, "device": self.device, "channel": self.channel, **dataclasses.asdict(self.missed),
        }  # fmt: skip

    @classmethod
    def of_event(cls, step: str, data: Mapping[str, Any]) -> Self:
        """Losses from an entry of the journal."""
        content = dict(data)
        return cls(step, content.pop("device"), content.pop("channel"), Missed.of_json(content))

    def in_words(self) -> str:
        """One line in English, for `bench reduce`."""
        text = f"{self.step}: {self.device} {self.channel}: {self.missed.lost} of {self.missed.expected}"
        gaps = f"{self.missed.gaps} gap{'s' * (self.missed.gaps > 1)}"
        return f"{text} {self.missed.what} lost, in {gaps}{_not_used(self.missed.unusable)}"


def _not_used(why: Sequence[str]) -> str:
    return f"; not used: {', '.join(why)}" if why else ""


def missed_in_run(
    reader: RunReader, bench: BenchFile, places: Iterable[str], data: Sequence[RunData]
) -> tuple[MissedIn, ...]:
    """Losses of the units in these places.

    For acquisitions in `data` from the recorded frames; for others, which no method reduces, from the journal, of the
    last execution of a step.
    """
    entries = [bench.places[place] for place in places]
    used = {
        (role, channel)
        for entry in entries
        for role in bench.measuring(entry)
        for channel in entry.measured_by.values()
    }
    reduced = {each.step: each for part in data for each in part.acquisitions}
    found = [
        MissedIn(step, device, channel, missed)
        for step, acquisition in reduced.items()
        for (device, channel), missed in acquisition.missed.items()
    ]
    visits = set(map(first_visit, reduced))
    others = {
        (first_visit(event.step), event.data["device"], event.data["channel"]): event
        for event in reader.events(EVENT)
        if first_visit(event.step) not in visits
    }
    found += [MissedIn.of_event(event.step, event.data) for event in others.values()]
    return tuple(each for each in found if (each.device, each.channel) in used)
