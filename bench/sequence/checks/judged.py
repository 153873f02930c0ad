"""Warnings on values without limits, whose runs end NOT JUDGED, and on data that no result uses."""

from __future__ import annotations

from collections.abc import Iterator

from bench.sequence.checks.remarks import Remark
from bench.sequence.plan.plan import Plan
from bench.sequence.steps.custom import Custom
from bench.sequence.steps.measuring import Acquire, Measure


def not_judged(plan: Plan) -> Iterator[Remark]:
    """Warnings for a sequence without any limit, and for labels that no method reduces."""
    results, steps = plan.sequence.results, [planned.step for planned in plan]
    measured = any(isinstance(step, Measure) and step.limits is not None for step in steps)
    if not measured and not any(entry.limits for entry in results) and not any(isinstance(s, Custom) for s in steps):
        yield Remark(
            "warning",
            "nothing-judged",
            ("results",) if results else (),
            "no value in this sequence has a limit: its runs end NOT JUDGED, with exit code 5",
            "Add limits to results or to measure steps to get PASS or FAIL",
        )
    reduced = {label for entry in results for label in entry.labels}
    reported: set[str] = set()
    for planned in plan:
        step = planned.step
        if isinstance(step, Acquire) and step.label not in reduced | reported:
            reported.add(step.label)
            yield Remark(
                "warning",
                "label-not-reduced",
                planned.place,
                f"no method reduces what is acquired under the label '{step.label}': it is recorded, but used in no "
                "result",
                f"Add a result with data: {step.label}, or correct the label",
            )
