"""State of the chambers after a run, from the record of their supervision, which is not under its seal."""

from __future__ import annotations

import datetime as dt
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple

from bench.figures.languages import tr
from bench.figures.times_and_sizes import instant
from bench.store.followed import Followed, followed

_HELD = ("held", "reading")
_LASTING = (*_HELD, "commanded", "arrived", "not_arrived", "handed_over", "ended")


class Afterwards(NamedTuple):
    """Last record on each chamber, ends of completed holds, and the number of unreadable lines."""

    last: tuple[Followed, ...] = ()
    holds: tuple[Followed, ...] = ()
    unreadable: int = 0

    @property
    def is_late(self) -> bool:
        """True if a chamber has not arrived, or if that is unknown."""
        return bool(self.unreadable) or any(each.event == "not_arrived" for each in self.last)


def afterwards(run: Path, chambers: Collection[str]) -> Afterwards:
    """Records until now about these chambers of a run."""
    last: dict[str, Followed] = {}
    holds: dict[str, Followed] = {}
    unreadable = 0
    for each in followed(run):
        if each is None:
            unreadable += 1
        elif each.role not in chambers:
            continue
        elif each.event in _LASTING:
            last[each.role] = each
        elif each.event == "hold_ends":
            holds[each.role] = each
    over = (hold for role, hold in holds.items() if role in last and last[role].event not in _HELD)
    return Afterwards(tuple(last.values()), tuple(over), unreadable)


def lines(found: Afterwards, zone: str) -> Iterator[str]:
    """Text lines in the language of the report; instants in the time zone of the laboratory."""
    for hold in found.holds:
        yield tr(
            "{role}: its set point was held until {time}: {why}.", role=hold.role, time=_at(hold, zone), why=hold.why
        )
    yield from (_in_words(each, _at(each, zone)) for each in found.last)
    if found.unreadable:
        yield tr("Entries of this record that cannot be read: {count}.", count=found.unreadable)


def _in_words(entry: Followed, time: str) -> str:
    role, why, air = entry.role, entry.why, _celsius(entry.air_c)
    match entry.event:
        case "arrived":
            return tr(
                "{role}: its air arrived at the safe set point at {time}, at {air}.", role=role, time=time, air=air
            )
        case "not_arrived":
            return tr("{role} HAS NOT ARRIVED at the safe set point ({time}): {why}", role=role, time=time, why=why)
        case "handed_over":
            return tr(
                "{role}: handed over at {time}, on its way to the safe set point: {why}", role=role, time=time, why=why
            )
        case "ended":
            return tr(
                "{role}: not followed any more since {time}; whether its air has arrived is not known.",
                role=role, time=time,
            )  # fmt: skip
        case "commanded":
            return tr(
                "{role}: the safe set point was commanded at {time}; that its air has arrived is not on record.",
                role=role, time=time,
            )  # fmt: skip
        case _:
            set_point = _celsius(entry.set_point_c)
            return tr(
                "{role}: held at {set_point}, last seen at {time} with its air at {air}.",
                role=role, set_point=set_point, time=time, air=air,
            )  # fmt: skip


def _celsius(value_c: float | None) -> str:
    return tr("not recorded") if value_c is None else f"{value_c:.1f} °C"


def _at(entry: Followed, zone: str) -> str:
    """Text of an instant; an invalid one is "not recorded"."""
    try:
        if dt.datetime.fromisoformat(entry.at).tzinfo is not None:
            return instant(entry.at, zone)
    except (ValueError, OverflowError):
        pass
    return tr("not recorded")
