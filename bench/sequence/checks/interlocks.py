"""Check of the interlocks of a sequence against a bench."""

from __future__ import annotations

from collections.abc import Iterator

from bench.config.checks_interlocks import interlock_misfits
from bench.config.document import Problem
from bench.config.models import BenchFile
from bench.sequence.plan.plan import Plan
from bench.sequence.plan.subsequences import declared_at


def interlocks(plan: Plan, bench: BenchFile) -> Iterator[Problem]:
    """Problems of the interlocks of a sequence on a bench; interlocks of the bench stay in force beside them."""
    declared = plan.sequence.interlocks
    for name in declared:
        if name in bench.interlocks:
            yield (
                declared_at(plan.document, "interlocks", name),
                f"the bench '{bench.title}' has an interlock '{name}', which stays in force; name this one otherwise",
            )
    for (_, misfit, *inner), problem in interlock_misfits(declared, bench):
        yield (*declared_at(plan.document, "interlocks", str(misfit)), *inner), problem
