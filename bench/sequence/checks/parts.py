"""Rules on the loops and groups that a method finds by name around the acquisitions of a result."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator

from bench.config.models import BenchFile
from bench.sequence.checks.acquired import acquired_under
from bench.sequence.checks.remarks import Found
from bench.sequence.method import NamedPart, known_methods
from bench.sequence.plan.plan import Plan
from drivers.schema.suggest import nearest


def missing_readings(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """A method's named loop or group that contains no acquisition of its data."""
    for index, entry in enumerate(plan.sequence.results):
        acquired = acquired_under(plan, entry.data)
        names = {part.partition("=")[0].partition("#")[0] for step_id in acquired for part in step_id.split("/")}
        wanted = [part for part in known_methods()[entry.method].parts if part.without and part.name not in names]
        if wanted and acquired:
            yield (
                ("results", index, "data"),
                f"no reading of '{entry.data}' is in a {'; '.join(_in_words(part, names) for part in wanted)}",
                f"Add it, or give the {' or the '.join(dict.fromkeys(part.kind for part in wanted))} this name",
            )


def unnumbered(visits: Iterable[tuple[str, Hashable]], loop: str) -> Iterator[str]:
    """Return the ids of steps that occur again without being in a loop of this name.

    `visits` are ids of steps, each with the key that identifies equal visits.
    """
    seen = set()
    for step_id, key in visits:
        if key in seen and not any(part.startswith(f"{loop}=") for part in step_id.split("/")):
            yield step_id
        seen.add(key)


def _in_words(part: NamedPart, names: set[str]) -> str:
    close = nearest(part.name, sorted(names))
    return f"{part.kind} '{part.name}'{f' (there is {close!r})' if close else ''}, so that {part.without}"
