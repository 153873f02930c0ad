"""The truth that results are held against shares no arithmetic with the reductions."""

import ast
from pathlib import Path

import numpy as np
import pytest

from bench.methods.tumble.reduction.solution import further_terms
from simulators.truth.constants import separable_terms

TRUTH = Path(__file__).parents[3] / "campaigns" / "truth"
MODULES = sorted([*TRUTH.glob("*.py"), *(TRUTH.parent / "flights").glob("*.py")])
RECORDS = {"bench.metrology.acquisition", "bench.metrology.run_data"}
NO_TRUTH = {"planted.py", "planted_channel.py", "signs.py"}  # they alter reductions, or compare them with each other
REPLAY = {"player.py": {"bench.metrology.outputs"}}  # makes the record that is reduced, windows in place of counts


def imported(path):
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom):
            yield from (node.module, *(f"{node.module}.{each.name}" for each in node.names))
        elif isinstance(node, ast.Import):
            yield from (each.name for each in node.names)


def test_the_programs_that_judge_by_the_truth_are_found():
    assert len(MODULES) > 20


@pytest.mark.parametrize("path", MODULES)
def test_no_truth_is_computed_by_a_reduction(path):
    if path.name in NO_TRUTH:
        return
    allowed = tuple(RECORDS | REPLAY.get(path.name, set()))
    reductions = ("bench.metrology", "bench.methods")
    assert [name for name in imported(path) if name.startswith(reductions) and not name.startswith(allowed)] == []


@pytest.mark.parametrize("count", [4, 5, 6, 8, 12, 16, 24, 36])
@pytest.mark.parametrize("offset_deg", [0.0, 1.0, 3.0])
def test_truth_and_reduction_come_to_the_same_further_terms_in_different_ways(count, offset_deg):
    angles_deg = np.arange(count) * 360 / count + offset_deg
    assert separable_terms(angles_deg.tolist()) == further_terms(np.radians(angles_deg))
