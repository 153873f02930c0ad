"""Lost frames of a run in its report: a line for each channel, and tables of acquisitions and of gaps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from bench.figures.languages import tr
from bench.figures.sheet import Sheet
from bench.metrology.missed import Gap
from bench.reduce.gaps import MissedIn
from bench.report.flag_words import reading_in_words

MOST_ROWS = 40  # rows of a table


def lines(found: Sequence[MissedIn]) -> Iterator[str]:
    """A line for each channel, for the deviations of the report."""
    for device, channel in dict.fromkeys((each.device, each.channel) for each in found):
        of_channel = [each for each in found if (each.device, each.channel) == (device, channel)]
        missed = [each.missed for each in of_channel]
        text = tr(
            "{device} {channel}: {lost} of {expected} {what} lost, in {gaps} gaps of {parts} acquisitions.",
            device=device, channel=channel, what=tr(missed[0].what), parts=len(missed),
            lost=sum(each.lost for each in missed), expected=sum(each.expected for each in missed),
            gaps=sum(each.gaps for each in missed),
        )  # fmt: skip
        not_used = [each.step for each in of_channel if each.missed.unusable]
        yield f"{text} {_consequence(not_used)}"


def _consequence(not_used: Sequence[str]) -> str:
    if not not_used:
        return tr("No mean is left out for this reason.")
    return tr("The means of these are not used: {steps}.", steps=", ".join(not_used))


def sheets(found: Sequence[MissedIn], began_s: float) -> Iterator[Sheet]:
    """A table of the acquisitions, and one of their gaps if these are few."""
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
