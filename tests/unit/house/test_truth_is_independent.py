"""The truth that results are held against shares no arithmetic with the reductions."""

import ast
from pathlib import Path

import numpy as np
import pytest

from bench.methods.tumble.reduction.solution import further_terms
from simulators.truth.constants import in_one_plane, separable_terms

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
    assert separable_terms(in_one_plane(angles_deg.tolist())) == further_terms(np.radians(angles_deg))


@pytest.mark.parametrize(
    ("other", "count"), [(0, 4), (0, 6), (0, 8), (0, 24), (6, 6), (4, 8), (8, 4), (8, 8), (12, 8), (12, 12)]
)
@pytest.mark.parametrize("offset_deg", [0.0, 1.0, 3.0])
def test_they_do_so_with_a_second_mount_too(count, other, offset_deg):
    angles_deg, again_deg = (np.arange(each) * 360 / max(each, 1) + offset_deg for each in (other, count))
    second_g = in_one_plane(again_deg.tolist())[:, [0, 2, 1]]  # the output axis in place of the pendulous axis
    forces_g = np.concatenate([in_one_plane(angles_deg.tolist()), second_g])
    clocked = np.repeat([False, True], [other, count])
    found = further_terms(np.radians(np.concatenate([angles_deg, again_deg])), clocked)
    assert separable_terms(forces_g) == found
    assert ("misalignment_y" in found) == (other > 0)
