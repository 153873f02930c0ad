"""Names of topics. Levels that are names of other people's making are encoded."""

from __future__ import annotations

import hashlib
import re
from typing import NamedTuple

LONGEST = 100
_NOT_ALLOWED = re.compile("[\x00-\x1f\x7f-\x9f+#/%\ud800-\udfff\ufdd0-\ufdef\ufffe\uffff]|^\\$")


def level(name: str) -> str:
    """Return a level of a topic for any name: different for different names, without wildcards and control characters.

    Such characters become `%` and two hexadecimal digits for each byte of UTF-8. The end of a long name becomes a hash.
    """
    if not name:
        return "%"
    text = _NOT_ALLOWED.sub(_encoded, name)
    if len(text) <= LONGEST:
        return text
    digest = hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()[:16]
    return f"{text[:LONGEST]}%~{digest}"


def _encoded(found: re.Match[str]) -> str:
    return "".join(f"%{byte:02X}" for byte in found.group().encode("utf-8", "surrogatepass"))


class Topics(NamedTuple):
    """Topics of a station."""

    station: str

    @property
    def status(self) -> str:
        """Topic of the status."""
        return f"bench/{self.station}/status"

    def of_bench(self, bench: str, kind: str) -> str:
        """Topic of a bench: `state`, `events`, `questions`, `alarms` or `results`."""
        return f"bench/{self.station}/{level(bench)}/{kind}"

    def reading(self, bench: str, channel: str) -> str:
        """Topic of the readings of a channel."""
        return f"{self.of_bench(bench, 'readings')}/{level(channel)}"

    def commands(self, user: str) -> str:
        """Topic of the commands of a user."""
        return f"bench/{self.station}/commands/{level(user)}"

    def replies(self, user: str) -> str:
        """Topic of the replies to a user."""
        return f"bench/{self.station}/replies/{level(user)}"


def bench_of_file(file: str, benches: dict[str, str]) -> str:
    """Return the name of the bench of a bench file; of one that the station does not have `~` and the name of the file.

    `benches` are names by bench file.
    """
    stem = file.rpartition("/")[2].removesuffix(".yaml")
    return benches.get(file) or f"~{stem}"
