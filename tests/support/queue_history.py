"""What may become of items of a queue, whoever changes them and whatever happens to the station."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

WAITING, FINAL = frozenset({"queued", "held"}), frozenset({"ended", "refused", "cancelled"})
_BEFORE_A_RUN = WAITING | FINAL | {"starting", "running"}  # a process may die before it begins
LATER = {**dict.fromkeys(("queued", "held", "starting"), _BEFORE_A_RUN), "running": {"running", "ended"}}
LATER |= {state: {state} for state in FINAL}

Json = Mapping[str, Any]


def faults_of_items(before: Mapping[str, Json], listed: Iterable[Json]) -> Iterator[str]:
    """Faults of a list of all items, given those that were answered before it was asked for, by id."""
    listed = list(listed)
    counts, found = Counter(item["id"] for item in listed), {item["id"]: item for item in listed}
    yield from (f"item {id_} is listed {count} times" for id_, count in counts.items() if count > 1)
    for id_, known in before.items():
        if (now := found.get(id_)) is None:
            yield f"item {known['number']} was answered as {known['state']} and is gone"
        elif problem := _fault_of_item(known, now):
            yield f"item {known['number']} was {known['state']} in version {known['version']}, and {problem}"


def _fault_of_item(known: Json, now: Json) -> str:
    if now["version"] < known["version"]:
        return f"is in version {now['version']}"
    if now["state"] not in LATER[known["state"]]:
        return f"is {now['state']}"
    if now["version"] == known["version"] and now["state"] != known["state"]:
        return f"is {now['state']} in the same version"
    if known["run"] and now["run"] != known["run"]:
        return f"had run {known['run']} and has '{now['run']}'"
    return ""
