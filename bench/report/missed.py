"""What did not come over the wires in a run: a line for each channel, and tables of acquisitions and of gaps."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

from bench.analysis.missed import EVENT, Gap, Missed
from bench.analysis.rundata import RunData
from bench.config.models import BenchFile
from bench.report.flag_words import reading_in_words
from bench.report.languages import tr
from bench.report.tables import Sheet
from bench.sequence.dwells import first_visit
from bench.store.reader import RunReader

MOST_ROWS = 40  # of a table


@dataclass(frozen=True, slots=True)
class MissedIn:
    """What did not come of a channel of a device during an acquisition."""

    step: str
    device: str
    channel: str
    missed: Missed

    def to_json(self) -> dict[str, Any]:
        """As in the journal of the run."""
        return {
            "step": self.step, "device": self.device, "channel": self.channel, **dataclasses.asdict(self.missed),
        }  # fmt: skip

    @classmethod
    def of_event(cls, step: str, data: Mapping[str, Any]) -> Self:
        """From an entry of the journal."""
        content = dict(data)
        return cls(step, content.pop("device"), content.pop("channel"), Missed.of_json(content))

    def in_words(self) -> str:
        """For `bench reduce`, which speaks English."""
        told = f"{self.step}: {self.device} {self.channel}: {self.missed.lost} of {self.missed.expected}"
        gaps = f"{self.missed.gaps} gap{'s' * (self.missed.gaps > 1)}"
        return f"{told} {self.missed.what} lost, in {gaps}{_not_used(self.missed.unusable)}"


def _not_used(why: Sequence[str]) -> str:
    return f"; not used: {', '.join(why)}" if why else ""


def missed_in_run(
    reader: RunReader, bench: BenchFile, places: Iterable[str], data: Sequence[RunData]
) -> tuple[MissedIn, ...]:
    """What did not come of the units in these places.

    Of acquisitions in `data` by what was recorded; of others, which no method reduces, by what the journal says, of a
    step that was done again the last time.
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


def lines(found: Sequence[MissedIn]) -> Iterator[str]:
    """A line for each channel, for the deviations of the report."""
    for device, channel in dict.fromkeys((each.device, each.channel) for each in found):
        of_channel = [each for each in found if (each.device, each.channel) == (device, channel)]
        missed = [each.missed for each in of_channel]
        told = tr(
            "{device} {channel}: {lost} of {expected} {what} lost, in {gaps} gaps of {parts} acquisitions.",
            device=device, channel=channel, what=tr(missed[0].what), parts=len(missed),
            lost=sum(each.lost for each in missed), expected=sum(each.expected for each in missed),
            gaps=sum(each.gaps for each in missed),
        )  # fmt: skip
        not_used = [each.step for each in of_channel if each.missed.unusable]
        yield f"{told} {_what_becomes(not_used)}"


def _what_becomes(not_used: Sequence[str]) -> str:
    if not not_used:
        return tr("No mean is left out for this reason.")
    return tr("The means of these are not used: {steps}.", steps=", ".join(not_used))


def sheets(found: Sequence[MissedIn], began_s: float) -> Iterator[Sheet]:
    """A table of the acquisitions, and one of their gaps where these are few."""
    if not found:
        return
    rows = tuple(
        (
            each.step, f"{each.device} {each.channel}", f"{each.missed.gaps}", f"{each.missed.lost}",
            f"{each.missed.expected}",
            "; ".join(map(reading_in_words, each.missed.unusable)) or tr("used"),
        )
        for each in found
    )  # fmt: skip
    yield Sheet(
        tr("Lost frames"),
        tr(
            "Detected by the numbers in the frames, never by their times. A mean rate is taken from the first and "
            "the last latch, whatever is missing in between; a mean of samples from those received. It is not used if "
            "less than half was received, or if a counter may have wrapped around unnoticed. Where intervals are "
            "used one "
            "by one, the one over a gap is left out."
        )
        + _more(rows),
        tuple((head, "") for head in (
            tr("Acquisition"), tr("Channel"), tr("Gaps"), tr("Lost"), tr("Of"), tr("Its mean")
        )),
        rows[:MOST_ROWS],
    )  # fmt: skip
    gaps = [(each, gap) for each in found for gap in each.missed.listed]
    if len(gaps) == sum(each.missed.gaps for each in found) and len(gaps) <= MOST_ROWS:
        yield _gaps(gaps, began_s)


def _more(rows: Sequence[object]) -> str:
    if len(rows) <= MOST_ROWS:
        return ""
    return " " + tr("{count} more are not shown; 'bench export' writes all of them.", count=len(rows) - MOST_ROWS)


def _gaps(gaps: Sequence[tuple[MissedIn, Gap]], began_s: float) -> Sheet:
    return Sheet(
        tr("Gaps"),
        tr(
            "Numbers count from the start of the acquisition and do not wrap as those in the frames do. The times "
            "are those "
            "of the frames before and after the gap, in seconds after the start, and the time between them by the "
            "clock in the frames."
        ),
        (
            (tr("Acquisition"), ""), (tr("Channel"), ""), (tr("First missing"), ""), (tr("Last missing"), ""),
            (tr("Before it"), "s"), (tr("After it"), "s"), (tr("By their clock"), "s"),
        ),
        tuple(
            (
                each.step, f"{each.device} {each.channel}", f"{gap.first}", f"{gap.last}",
                _seconds(gap.from_s, began_s), _seconds(gap.to_s, began_s), _seconds(gap.device_s, 0.0),
            )
            for each, gap in gaps
        ),
    )  # fmt: skip


def _seconds(at_s: float | None, since_s: float) -> str:
    return f"{at_s - since_s:.3f}" if at_s is not None else "–"
