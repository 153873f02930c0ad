"""Document number `index` of a campaign with a seed: always the same bytes."""

from __future__ import annotations

import random
from dataclasses import dataclass

from campaigns.hostile import attacks, mutations, plans
from campaigns.hostile.corpus import Generator

# How often each kind is made: what most documents are, somebody's mistake, comes most often.
_WEIGHTS: dict[Generator, int] = {
    mutations.by_lines: 24, mutations.by_characters: 12, mutations.by_bytes: 4, mutations.by_parts: 14,
    attacks.depth: 3, attacks.long: 5, attacks.many: 4, attacks.aliases: 3, attacks.tags: 3, attacks.escapes: 3,
    attacks.strange_scalars: 5, attacks.encodings: 3, attacks.soup: 3,
    plans.steps: 6, plans.calls: 1, plans.expressions: 5, plans.ranges: 2, plans.explosions: 1, plans.mistakes: 2,
}  # fmt: skip
KINDS = tuple(_WEIGHTS)


@dataclass(frozen=True)
class Hostile:
    """A document, and which of KINDS it is."""

    index: int
    kind: str
    data: bytes


def hostile(seed: int, index: int) -> Hostile:
    """The document; a character that UTF-8 cannot spell is written as others would write it."""
    rng = random.Random(f"{seed}/{index}")
    generator = rng.choices(KINDS, weights=list(_WEIGHTS.values()))[0]
    made = generator(rng)
    data = made if isinstance(made, bytes) else made.encode("utf-8", "surrogatepass")
    return Hostile(index, f"{generator.__module__.rpartition('.')[2]}.{generator.__name__}", data)
