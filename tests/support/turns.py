"""A pytest plugin: slow tests take turns; BENCH_TURN=1/3 leaves out all but a third of their files.

CI takes its turn from the time of the commit, so that a few commits run all of them; `make slow` runs all at once. A
turn has every n-th file of campaigns and every n-th of the others, in alphabetical order, and the files that are
ALWAYS run: what safety, security and a first use stand on.
"""

from __future__ import annotations

import os

import pytest

CAMPAIGNS = ("tests/campaigns/", "tests/system/methods/", "tests/truth/")
ALWAYS = tuple(
    f"tests/integration/test_{name}.py"
    for name in (
        "a_day", "guardian", "mqtt", "station", "station_in_hostile_browser", "station_under_attack", "wheel", "wires"
    )
)  # fmt: skip
Turn = tuple[int, int]  # its number from 1 on, and how many there are


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the slow tests whose turn it is not."""
    if (turn := turn_of(os.environ.get("BENCH_TURN", "1/1"))) == (1, 1):
        return
    out = left_out({_file(item) for item in items if "slow" in item.keywords}, turn)
    gone = [item for item in items if "slow" in item.keywords and _file(item) in out]
    config.hook.pytest_deselected(items=gone)
    left = set(gone)
    items[:] = [item for item in items if item not in left]


def turn_of(text: str) -> Turn:
    """Return the turn of a text such as 1/3. Raises UsageError for one that cannot be."""
    number, _, turns = text.partition("/")
    if not (number.isdigit() and turns.isdigit() and 1 <= int(number) <= int(turns)):
        raise pytest.UsageError(f"BENCH_TURN is {text}, expected a turn such as 1/3")
    return int(number), int(turns)


def left_out(files: set[str], turn: Turn) -> set[str]:
    """Return the files whose turn it is not."""
    number, turns = turn
    campaigns = sorted(file for file in files if file.startswith(CAMPAIGNS))
    others = sorted(files.difference(campaigns, ALWAYS))
    return {file for part in (campaigns, others) for place, file in enumerate(part) if place % turns != number - 1}


def _file(item: pytest.Item) -> str:
    return item.nodeid.partition("::")[0]
