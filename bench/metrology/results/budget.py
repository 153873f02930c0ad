"""Lines of an uncertainty budget."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

NEGLIGIBLE = 1e-4  # relative to the largest line of a budget: 1e-8 of its variance


@dataclass(frozen=True, slots=True)
class BudgetLine:
    """One source of uncertainty: `u` in the unit of the finding, `dof` None for unlimited.

    Lines of several findings with the same `shared` are the same error, fully correlated. An `alias` is a confounded
    term: a part of the value that this method cannot separate from it.
    """

    source: str
    type: Literal["A", "B", "alias"]
    u: float
    dof: int | None = None
    shared: str | None = None

    def times(self, factor: float) -> BudgetLine:
        """The line for `factor` times the value."""
        return replace(self, u=float(self.u * factor))


def combined(lines: Sequence[BudgetLine]) -> tuple[BudgetLine, ...]:
    """Lines of a budget that contribute, largest first; an alias is kept whatever its size.

    The sign of a line, from a value or a derivative, is removed.
    """
    lines = [replace(line, u=abs(line.u)) for line in lines]
    least = NEGLIGIBLE * max((line.u for line in lines), default=0.0)
    kept = [line for line in lines if line.u > least or line.type == "alias"]
    return tuple(sorted(kept, key=lambda line: -line.u))
