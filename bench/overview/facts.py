"""Facts of received messages, whoever has sent them: of the expected types, printable, and of bounded length."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from typing import Any
from urllib.parse import unquote, urlsplit
from zoneinfo import available_timezones

LONGEST = 200
LARGEST_NUMBER = 10**9
FARTHEST = timedelta(days=20 * 365)  # from now, of an instant
FARTHEST_END = timedelta(days=400)


class Facts:
    """Keys of a message. A missing one has its empty value; so has one that does not fit, which `misfits` then lists.

    Keys that are not asked for, as those of later versions of the program, do not matter.
    """

    def __init__(self, found: Mapping[str, Any], misfits: set[str] | None = None) -> None:
        self._found, self.misfits = found, misfits if misfits is not None else set()

    def text(self, key: str, most: int = LONGEST) -> str:
        """Return a text as one line."""
        found = self._of(key, str, "")
        return clean(found, most)

    def texts(self, key: str, count: int, most: int = LONGEST) -> tuple[str, ...]:
        """Return the last texts of a list."""
        return tuple(clean(each, most) for each in self._list(key, count) if isinstance(each, str))

    def by_name(self, key: str, names: tuple[str, ...], most: int = LONGEST) -> dict[str, str]:
        """Return the texts of a mapping that have one of these names."""
        found = self._of(key, dict, {})
        return {name: clean(found[name], most) for name in names if isinstance(found.get(name), str)}

    def parts(self, key: str, count: int) -> Iterator[Facts]:
        """Yield the facts of each of the last mappings of a list."""
        for each in self._list(key, count):
            if isinstance(each, dict):
                yield Facts(each, self.misfits)

    def whole(self, key: str) -> int:
        """Return a whole number that is not negative."""
        found = self._of(key, int, 0)
        return min(max(found, 0), LARGEST_NUMBER) if not isinstance(found, bool) else 0

    def number(self, key: str) -> float | None:
        """Return a finite number; None without one."""
        found = self._of(key, (int, float), None)
        try:
            return float(found) if found is not None and math.isfinite(found) else None
        except OverflowError:
            self.misfits.add(key)
            return None

    def flag(self, key: str) -> bool:
        """Return True or False."""
        return bool(self._of(key, bool, False))

    def instant(self, key: str, now: datetime, within: timedelta = FARTHEST) -> datetime | None:
        """Return an instant in UTC that is not far from now; None without one."""
        text = self._of(key, str, "")
        if not text:
            return None
        try:
            found = datetime.fromisoformat(text[:64]).astimezone(UTC) if _has_zone(text) else None
        except (ValueError, OverflowError):
            found = None
        if found is None or abs(found - now) > within:
            self.misfits.add(key)
            return None
        return found

    def zone(self, key: str) -> str:
        """Return the name of a time zone; empty for one that is not known here."""
        found = self._of(key, str, "")
        return found if found in _zones() else ""

    def address(self, key: str) -> str:
        """Return an address of the web; empty for any other."""
        found = self._of(key, str, "")
        return found if is_address(found) else ""

    def _list(self, key: str, count: int) -> list[Any]:
        found: list[Any] = self._of(key, list, [])
        return found[-count:]

    def _of(self, key: str, kind: type | tuple[type, ...], empty: Any) -> Any:
        found = self._found.get(key)
        if found is None:
            return empty
        if not isinstance(found, kind):
            self.misfits.add(key)
            return empty
        return found


def facts_of(payload: bytes) -> Facts:
    """Return the facts of a message. Raises ValueError if it is no JSON object in UTF-8."""
    try:
        found = json.loads(payload.decode("utf-8"))
    except RecursionError:
        raise ValueError("nested too deeply") from None
    if not isinstance(found, dict):
        raise ValueError("is no object")
    return Facts(found)


def clean(text: str, most: int = LONGEST) -> str:
    """Return a text as one line without control characters, marks of direction and half characters."""
    shown = "".join(each if each.isprintable() else " " for each in text[: 2 * most])
    line = " ".join(shown.split())
    return line if len(line) <= most else f"{line[: most - 1]}…"


def name_of(level: str) -> str:
    """Return the name of a level of a topic."""
    return clean(unquote(level, errors="replace"), 100) or "%"


def is_address(text: str) -> bool:
    """Return True for an address of the web without a name of a user."""
    if len(text) > LONGEST or not text.isascii() or not text.isprintable() or set(text) & set(" \\\"'<>`"):
        return False
    try:
        found = urlsplit(text)
        is_web = found.scheme in ("http", "https") and bool(found.hostname)
        return is_web and "@" not in found.netloc and found.port != 0
    except ValueError:
        return False


def _has_zone(text: str) -> bool:
    return datetime.fromisoformat(text[:64]).tzinfo is not None


@lru_cache(maxsize=1)
def _zones() -> frozenset[str]:
    return frozenset(available_timezones())
