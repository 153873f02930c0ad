"""A pytest plugin: campaigns among the slow tests take turns; BENCH_TURN=1/3 leaves out all but a third of them.

CI takes its turn from the time of the commit, so that a few commits run all of them; `make slow` runs all at once. A
turn has every n-th file of these folders, in alphabetical order.
"""

from __future__ import annotations

import os

import pytest

CAMPAIGNS = ("tests/campaigns/", "tests/system/methods/", "tests/truth/")
Turn = tuple[int, int]  # its number from 1 on, and how many there are


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the campaigns whose turn it is not."""
    if (turn := turn_of(os.environ.get("BENCH_TURN", "1/1"))) == (1, 1):
        return
    out = left_out({path for item in items if (path := _campaign(item)) is not None}, turn)
    config.hook.pytest_deselected(items=[item for item in items if _campaign(item) in out])
    items[:] = [item for item in items if _campaign(item) not in out]


def turn_of(text: str) -> Turn:
    """Return the turn of a text such as 1/3. Raises UsageError for one that cannot be."""
    number, _, turns = text.partition("/")
    if not (number.isdigit() and turns.isdigit() and 1 <= int(number) <= int(turns)):
        raise pytest.UsageError(f"BENCH_TURN is {text}, expected a turn such as 1/3")
    return int(number), int(turns)


def left_out(files: set[str], turn: Turn) -> set[str]:
    """Return the files whose turn it is not."""
    number, turns = turn
    return {file for place, file in enumerate(sorted(files)) if place % turns != number - 1}


def _campaign(item: pytest.Item) -> str | None:
    path = item.nodeid.partition("::")[0]
    return path if path.startswith(CAMPAIGNS) and "slow" in item.keywords else None
