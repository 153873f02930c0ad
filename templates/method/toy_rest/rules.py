"""Rules on a sequence that uses the method: enough readings, and no move between them."""

from collections.abc import Iterator

from bench.config.models import BenchFile
from bench.sequence.checks.acquired import acquired_under, results_by
from bench.sequence.checks.remarks import Found, Rule
from bench.sequence.plan.plan import Plan
from bench.sequence.steps.stimulus import Move

from toy_rest.method import DESCRIPTION, ToyRestSettings


def too_few_readings(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """Report fewer acquisitions than the setting `fewest`."""
    for place, entry in results_by(plan, DESCRIPTION.name):
        fewest = ToyRestSettings.model_validate(entry.settings).fewest
        count = len(acquired_under(plan, entry.data))
        if count < fewest:
            yield (
                (*place, "data"),
                f"'{entry.data}' has {count} readings; below {fewest}, the setting fewest, no drift is stated",
                "Acquire more often, or for a shorter time each",
            )


def moved_at_rest(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """Report a move between the first acquisition and the last."""
    for _, entry in results_by(plan, DESCRIPTION.name):
        steps, acquired = list(plan), set(acquired_under(plan, entry.data))
        read = [number for number, each in enumerate(steps) if each.id in acquired]
        for each in steps[read[0] : read[-1]] if read else ():
            if isinstance(each.step, Move):
                yield (
                    (*each.place, "move"),
                    f"'{each.step.role}' moves between readings under '{entry.data}', which are to be at rest",
                    "Move before the first reading",
                )


RULES = (
    Rule("toy_rest-too-few", "error", "a drift at rest has enough readings", too_few_readings),
    Rule("toy_rest-moved", "error", "nothing moves between readings at rest", moved_at_rest),
)
