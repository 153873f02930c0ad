"""Lines of an uncertainty budget.

A source of uncertainty is the line of its own error. Times the sensitivity of a result to that error, its gain, it is a
line in the budget of the result.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

NEGLIGIBLE = 1e-4  # relative to the largest line of a budget: 1e-8 of its variance


class BudgetLine(NamedTuple):
    """One source of uncertainty: `u` in the unit of the finding, `dof` None for unlimited.

    Lines of several findings with the same `shared` are the same error, fully correlated. An `alias` is a confounded
    term: a part of the value that this method cannot separate from it. By its `kind` a reduction knows a
    line again; results do not have it.
    """

    source: str
    type: Literal["A", "B", "alias"]
    u: float
    dof: int | None = None
    shared: str | None = None
    kind: str = ""

    def times(self, gain: float, source: str = "") -> BudgetLine:
        """The line for `gain` times the value; `source` renames it."""
        return self._replace(u=float(self.u * gain), source=source or self.source)


def common(source: str, u: float, kind: str = "") -> BudgetLine:
    """Line of an error that all results have."""
    return BudgetLine(source, "B", float(u), None, source.replace(": ", ".").replace(" ", "_"), kind)


def gain_and_offset(instrument: str, gain_u: float, offset_u: float) -> tuple[BudgetLine, BudgetLine]:
    """Errors of an instrument by its certificate: of its gain, relative, and of its offset, in its own unit."""
    return common(f"{instrument}: gain", gain_u), common(f"{instrument}: offset", offset_u)


def combined(lines: Sequence[BudgetLine]) -> tuple[BudgetLine, ...]:
    """Lines of a budget that contribute, largest first; an alias is kept whatever its size.

    The sign of a line, from a value or a derivative, is removed.
    """
    lines = [line._replace(u=abs(line.u)) for line in lines]
    least = NEGLIGIBLE * max((line.u for line in lines), default=0.0)
    kept = [line for line in lines if line.u > least or line.type == "alias"]
    return tuple(sorted(kept, key=lambda line: -line.u))
