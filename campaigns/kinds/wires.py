"""Kind `wires`: faults on the lines to instruments and on CAN buses, swapped instruments and second masters."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.campaign.tasks import Known, Task
from campaigns.can_faults import campaign as can
from campaigns.line_faults.__main__ import MEANING, in_words
from campaigns.line_faults.campaign import play
from campaigns.line_faults.cases import CASES
from campaigns.line_faults.gain import UNPROTECTED, believed, one_take
from campaigns.line_faults.orders import ORDERS, play_orders
from campaigns.swaps import campaign as swapped

ORDERS_OF_READINGS = 10
SHARE_OF_SWAPS = 10
OF_CAN, OF_SWAPS = 500, 100  # in a task
SHOWN = 5


@dataclass(frozen=True)
class Wires:
    """Campaign of so many readings over all dialects, a tenth of orders and of exchanges, and half of acquisitions."""

    trials: int
    name: str = "wires"

    def tasks(self, known: Known) -> Sequence[Task]:
        """A task for each dialect, and blocks of exchanges and acquisitions."""
        return list(self._tasks())

    def lines(self, known: Known, out: Path) -> Iterator[str]:
        """What became of the faults by dialect, by kind of line, and what should not be there."""
        sums: dict[str, Counter[str]] = defaultdict(Counter)
        for task in self._tasks():
            content = _content(task, known)
            if content is None:
                continue
            sums[content["of"]].update(content["outcomes"])
            if task.sort != "gain":
                yield f"{task.key:<44} {in_words(Counter(content['outcomes']))}"
            yield from (f"    {sentence}" for sentence in content["unexpected"][:SHOWN])
        yield ""
        for what, outcomes in sums.items():
            yield f"{what}: {in_words(outcomes)}"
        bad = sum(len(content["unexpected"]) for content in self._contents(known))
        yield "wires: " + (f"{bad} UNEXPECTED" if bad else "ok")

    def exit_code(self, known: Known) -> int:
        """Return 1 if anything happened that must not."""
        return 1 if any(content["unexpected"] for content in self._contents(known)) else 0

    def _contents(self, known: Known) -> list[Mapping[str, Any]]:
        return [content for task in self._tasks() if (content := _content(task, known)) is not None]

    def _tasks(self) -> Iterator[Task]:
        each = -(-self.trials // len(CASES))
        yield from (_task(f"readings of {name}", "readings", name=name, trials=each) for name in CASES)
        each = -(-self.trials // ORDERS_OF_READINGS // len(ORDERS))
        yield from (_task(f"orders to {name}", "orders", name=name, trials=each) for name in ORDERS)
        each = max(1, self.trials // 100)
        yield from (_task(f"turned bits, {takes} taken", "turned", takes=takes, trials=each) for takes in (1, 2))
        for what in EXCHANGES:
            for first in range(0, self.trials // SHARE_OF_SWAPS, OF_SWAPS):
                seed = 1 + first // OF_SWAPS
                yield _task(
                    f"{what} {first}-{first + OF_SWAPS - 1}", "exchanges", what=what, trials=OF_SWAPS, seed=seed
                )
        for first in range(0, self.trials // 2, OF_CAN):
            yield _task(f"acquisitions {first}-{first + OF_CAN - 1}", "acquisitions", first=first, count=OF_CAN)


EXCHANGES = {"swaps": swapped.swaps, "second masters": swapped.second_masters}


def campaign(*, trials: int) -> Wires:
    """The campaign of a command line."""
    return Wires(trials)


def readings(name: str, trials: int) -> Mapping[str, Any]:
    """Readings of one dialect, each with a fault."""
    tally = play(name, CASES[name], trials, 1)
    return _counted(MEANING[CASES[name].link], tally.outcomes, tally.unexpected)


def orders(name: str, trials: int) -> Mapping[str, Any]:
    """Orders to one dialect, each with a fault."""
    tally = play_orders(name, trials, 1)
    return _counted("orders", tally.outcomes, tally.unexpected)


def turned(takes: int, trials: int) -> Mapping[str, Any]:
    """Turned bits on serial lines without a checksum, where values are taken once or twice."""
    if takes == 1:
        with one_take():
            count, _ = believed(trials, 1)  # what one take believes is what is counted
        unexpected: list[str] = []
    else:
        count, unexpected = believed(trials, 1)
    outcomes = Counter({"believed": count, "not": trials * len(UNPROTECTED) - count})
    return _counted(f"bits turned on lines without a checksum, {takes} taken", outcomes, unexpected)


def exchanges(what: str, trials: int, seed: int) -> Mapping[str, Any]:
    """Instruments that exchange their ports, or that somebody else sets."""
    tally = EXCHANGES[what](trials, seed)
    return _counted(what, tally.outcomes, tally.unexpected)


def acquisitions(first: int, count: int) -> Mapping[str, Any]:
    """Acquisitions of counters on buses with faults."""
    tally = can.play(range(first, first + count), 1)
    return _counted("axes of counters on bad buses", tally.outcomes, tally.unexpected)


def _counted(of: str, outcomes: Mapping[Any, int], unexpected: Sequence[str]) -> Mapping[str, Any]:
    return {
        "of": of,
        "outcomes": {str(what): count for what, count in outcomes.items()},
        "unexpected": list(unexpected),
    }


def _task(key: str, function: str, **arguments: Any) -> Task:
    return Task(key, f"campaigns.kinds.wires:{function}", arguments, sort="gain" if function == "turned" else function)


def _content(task: Task, known: Known) -> Mapping[str, Any] | None:
    result = known(task)
    return result.content if result is not None and result.is_finished else None
