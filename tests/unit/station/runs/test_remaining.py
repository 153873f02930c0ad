"""When a run ends: by earlier runs of the same plan, or by the limits of its soaks."""

import shutil

import pytest

from bench.station.runs.catalogue import Catalogue
from bench.station.runs.remaining import Course, Left, earlier_courses, left_by_courses, left_by_plan
from bench.store.tail import Tail
from tests.support.runs import run_short

SOAK = {"verb": "soak", "until_stable": {"band_c": 1.0}, "at_least_s": 600.0, "give_up_after_s": 7200.0}
PLAN = [
    {"id": "ramp", "begin_s": 0.0, "duration_s": 300.0, "facts": {"verb": "ramp"}},
    {"id": "soak", "begin_s": 300.0, "duration_s": 900.0, "facts": SOAK},
    {"id": "acquire", "begin_s": 1200.0, "duration_s": 60.0, "facts": {"verb": "acquire"}},
]


def course(soak_s):
    return Course({"ramp": (0.0, 300.0), "soak": (300.0, 300.0 + soak_s), "acquire": (300.0 + soak_s, 360.0 + soak_s)},
                  360.0 + soak_s)  # fmt: skip


def test_the_plan_is_bounded_by_the_limits_of_its_soaks():
    assert left_by_plan(PLAN, 1260.0, 0, 0.0) == Left(1260.0, 960.0, 1260.0 + 6300.0)
    assert left_by_plan(PLAN, 1260.0, 1, 700.0) == Left(260.0, 60.0, 260.0 + 6300.0)
    assert left_by_plan(PLAN, 1260.0, 1, 1000.0) == Left(60.0, 60.0, 60.0 + 6200.0)  # longer than planned
    assert left_by_plan(PLAN, 1260.0, 2, 20.0) == Left(40.0, 40.0, 40.0)


def test_two_earlier_runs_bound_what_is_left():
    assert left_by_courses([course(700.0)], "soak", 0.0) is None
    courses = [course(700.0), course(1000.0), course(1300.0)]
    assert left_by_courses(courses, "ramp", 100.0) == Left(1260.0, 960.0, 1560.0, 3)
    assert left_by_courses(courses, "soak", 800.0) == Left((60.0 + 260.0 + 560.0) / 3, 60.0, 560.0, 3)
    assert left_by_courses(courses, "other", 0.0) is None


@pytest.mark.lengthy
def test_courses_are_those_of_completed_runs_of_the_same_plan(tmp_path):
    first = run_short(tmp_path, sequence="smoke").path
    for number in (2, 3):
        shutil.copytree(first, tmp_path / f"{first.name}_{number}")
    other = tmp_path / f"{first.name}_3" / "manifest.json"
    other.write_text(other.read_text().replace('"sequence": "smoke"', '"sequence": "other"'))
    catalogue = Catalogue(tmp_path)
    (found,) = earlier_courses(catalogue, catalogue.run(first.name))
    with Tail(first) as tail:
        events = tail.events()
    assert found.end_s == events[-1].at_s
    soak = next(each.step for each in events if each.step.endswith("soak"))
    begun, ended = (each.at_s for each in events if each.step == soak and each.kind in ("step_begins", "step_ended"))
    assert found.steps[soak] == (begun, ended)
