"""Lines of an uncertainty budget."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

NEGLIGIBLE = 1e-4  # of the largest line of a budget: 1e-8 of its variance


@dataclass(frozen=True, slots=True)
class BudgetLine:
    """One source of uncertainty: `u` in the unit of the finding, `dof` None for unlimited.

    Lines of several findings with the same `shared` are one and the same error and not independent. An `alias` is
    something that the value contains and that this method cannot separate from it. By its `kind` a reduction knows a
    line again; results do not have it.
    """

    source: str
    type: Literal["A", "B", "alias"]
    u: float
    dof: int | None = None
    shared: str | None = None
    kind: str = ""

    def times(self, factor: float) -> BudgetLine:
        """The line for a value that is `factor` times the one it is of."""
        return replace(self, u=float(self.u * factor))


def combined(lines: Sequence[BudgetLine]) -> tuple[BudgetLine, ...]:
    """The lines of a budget that contribute, largest first; an alias is kept whatever it is worth.

    A line may be made with the sign of a value or of a derivative; the sign is no part of an uncertainty.
    """
    lines = [replace(line, u=abs(line.u)) for line in lines]
    least = NEGLIGIBLE * max((line.u for line in lines), default=0.0)
    kept = [line for line in lines if line.u > least or line.type == "alias"]
    return tuple(sorted(kept, key=lambda line: -line.u))
