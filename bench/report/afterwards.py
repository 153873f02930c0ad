"""State of the chambers after a run for its report, from `followed.jsonl`, which the seal does not cover."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple

from bench.figures.after_run import chamber_sentence, time_of
from bench.figures.languages import tr
from bench.store.followed import Followed, followed

_HELD = ("held", "reading")
_LASTING = (*_HELD, "commanded", "arrived", "not_arrived", "handed_over", "ended")


class Afterwards(NamedTuple):
    """Last recorded state of each chamber, ends of holds, and number of lines that cannot be read."""

    last: tuple[Followed, ...] = ()
    holds: tuple[Followed, ...] = ()
    unreadable: int = 0

    @property
    def is_late(self) -> bool:
        """True if a chamber has not arrived, or if the record is partly unreadable."""
        return bool(self.unreadable) or any(each.event == "not_arrived" for each in self.last)


def afterwards(run: Path, chambers: Collection[str]) -> Afterwards:
    """Return the present record about these chambers of a run."""
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
    """Yield the states in the language of the report, with times in the time zone of the laboratory."""
    for hold in found.holds:
        yield tr(
            "{role}: its set point was held until {time}: {why}.",
            role=hold.role, time=time_of(hold, zone), why=hold.why,
        )  # fmt: skip
    yield from (f"{each.role}{tr(': ')}{chamber_sentence(each, zone)}" for each in found.last)
    if found.unreadable:
        yield tr("Entries of this record that cannot be read: {count}.", count=found.unreadable)
