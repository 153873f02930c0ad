"""State of a chamber after a run as a sentence: in reports, `bench status` and `bench make-safe`."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

from bench.figures.languages import tr
from bench.figures.times_and_sizes import instant
from bench.store.followed import Followed, followed

_HELD = "held by its guardian at {set_point}, last read at {time} with its air at {air}."
SENTENCES = {
    "safe": "safe since {time}: {what}",
    "unread": "safe set point {set_point} commanded; its air could not be read: {why}",
    "on its way": "its air is at {air}, on its way to the safe set point {set_point}.",
    "commanded": "the safe set point was commanded at {time}; that its air has arrived is not on record.",
    "held": _HELD,
    "reading": _HELD,
    "not_seen": "held by its guardian; it could not be read at {time}: {why}",
    "arrived": "its air arrived at the safe set point at {time}, at {air}.",
    "not_arrived": "HAS NOT ARRIVED at the safe set point ({time}): {why}",
    "handed_over": "handed over at {time}, on its way to the safe set point: {why}",
    "ended": "no longer followed since {time}{reason}; whether its air has arrived is not known.",
}


def last_states(run: Path, zone: str = "UTC") -> dict[str, str]:
    """Return the last recorded state of each device after a run as a sentence, by role."""
    entries = (each for each in followed(run) if each is not None and each.event in SENTENCES)
    return {each.role: chamber_sentence(each, zone) for each in entries}


def chamber_sentence(entry: Followed, zone: str) -> str:
    """Return the state of a chamber in the language of the report, with its time in the time zone `zone`.

    The sentence continues "chamber: ". A `commanded` entry with a temperature is a reading on the way to the set point.
    """
    return tr(
        SENTENCES[_state(entry)],
        time=time_of(entry, zone),
        air=_celsius(entry.air_c),
        set_point=_celsius(entry.set_point_c),
        why=entry.why,
        reason=f" ({entry.why})" if entry.why else "",
        what=entry.what,
    )


def _state(entry: Followed) -> str:
    if entry.event != "commanded":
        return entry.event
    if entry.is_complete:
        return "safe"
    if entry.why:
        return "unread"
    return "commanded" if entry.air_c is None else "on its way"


def _celsius(value_c: float | None) -> str:
    return tr("not recorded") if value_c is None else f"{value_c:.1f} °C"


def time_of(entry: Followed, zone: str) -> str:
    """Return the time of an entry in a time zone; "not recorded" if the entry has no valid instant."""
    try:
        if dt.datetime.fromisoformat(entry.at).tzinfo is not None:
            return instant(entry.at, zone)
    except (ValueError, OverflowError):
        pass
    return tr("not recorded")
