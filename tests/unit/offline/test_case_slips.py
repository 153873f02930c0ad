"""Slips of people who recorded a case elsewhere; more of them: `python -m campaigns.trials --only slips_in_cases`."""

import numpy as np
import pytest

from bench.methods.indexing.doubts import sweep
from bench.metrology.results.flag import Flag
from bench.offline.case import reduce_case, reduced_case, reductions
from campaigns.trials.slips_in_cases import SLIPS, missed, no_cell_is_trusted
from tests.support.any_case import KINDS, good_case

OTHERWISE = "in other words"
JUDGED = {("M3", "gyro_range"), ("M3", "acc_range"), ("M4", "dynamic")}


def test_there_is_a_good_case_of_every_kind():
    assert set(KINDS) == set(reductions()) == {(slip.method, slip.sub) for slip in SLIPS}


@pytest.mark.parametrize("kind", KINDS)
def test_a_good_case_raises_no_doubt_and_neither_does_one_that_reads_downwards(tmp_path, kind):
    case = good_case(*kind)
    assert reduce_case(case.write(tmp_path))["flags"] == []
    for column in ("V_mean", "V", "U_V", *(f"{sensor}{axis}" for sensor in "NW" for axis in "xyz")):
        case[column] = lambda values: -values
    if "K1_V_per_g" in case.settings:
        case.settings["K1_V_per_g"] *= -1
    found = reduced_case(case.write(tmp_path))
    assert (found.content["flags"], found.outcome) == ([], "PASS" if kind in JUDGED else "REDUCED")


@pytest.mark.parametrize("slip", SLIPS, ids=lambda slip: f"{slip.method} {slip.sub} {slip.name}")
def test_a_slip_is_seen(slip):
    assert missed(slip) == ""


@pytest.mark.parametrize(("down_v_per_g", "is_doubted"), [(5.0, False), (-5.0, True), (1.0, True)])
def test_scale_factors_of_both_ends_that_do_not_agree_are_doubted(down_v_per_g, is_doubted):
    angle_deg = np.array([-4.0, 0.0, 4.0])
    lines = {"up": (5.0, 0.0), "down": (down_v_per_g, 0.0)}
    doubts = list(sweep(angle_deg, np.array([-0.3482, 0.0012, 0.3504]), lines, {}))
    assert [doubt.flag for doubt in doubts] == ["implausible_scale"] * is_doubted


OUTPUTS = (
    ("M0", "", "cum_pos"), ("M1", "", "V_mean"), ("M1", "", "V"),
    *(("M2", "", f"{counted}{axis}") for counted in "NW" for axis in "xyz"),
    ("M3", "gyro_range", "out_dps"), ("M3", "acc_range", "acc_g"), ("M3", "gyro_freq", "gyro_dps"),
    ("M3", "acc_freq", "acc_g"), ("M4", "static", "U_V"), ("M4", "dynamic", "U_V"), ("M4", "tilt", "U_V"),
)  # fmt: skip


@pytest.mark.parametrize(("method", "sub", "column"), OUTPUTS)
def test_an_output_that_never_changes_neither_passes_nor_is_reduced(tmp_path, method, sub, column):
    for value in (0.0, 0.25):
        case = good_case(method, sub)
        case[column] = lambda values, value=value: np.full_like(values, value)
        assert reduced_case(case.write(tmp_path)).outcome in ("INCOMPLETE", "FAIL"), value


def test_a_radius_of_a_dead_output_is_not_determined(tmp_path):
    case = good_case("M3", "acc_range")
    case["acc_g"] = np.zeros_like
    found = reduced_case(case.write(tmp_path))
    assert found.lacking[:2] == ("radius_not_determined", "invalid")
    assert list(found.lacking) == found.content["flags"]


def test_the_wording_of_a_flag_decides_nothing(tmp_path, monkeypatch):
    paths = {}
    for kind in KINDS:
        case = good_case(*kind)
        case.first_rows(1)
        (folder := tmp_path / "_".join(kind)).mkdir()
        paths[kind] = case.write(folder)
    told = {kind: reduced_case(path) for kind, path in paths.items()}
    monkeypatch.setattr(Flag, "__str__", lambda _: OTHERWISE)
    otherwise = {kind: reduced_case(path) for kind, path in paths.items()}
    assert sum(OTHERWISE in found.lacking for found in otherwise.values()) > len(KINDS) / 2
    for kind, found in otherwise.items():
        assert (found.outcome, len(found.lacking)) == (told[kind].outcome, len(told[kind].lacking)), kind


@pytest.mark.parametrize("kind", KINDS)
def test_a_record_of_one_row_or_none_is_not_complete(tmp_path, kind):
    case = good_case(*kind)
    case.first_rows(1)
    assert reduced_case(case.write(tmp_path)).outcome == ("REDUCED" if kind == ("M3", "two_sample") else "INCOMPLETE")
    case.first_rows(0)
    assert reduced_case(case.write(tmp_path)).outcome == "INCOMPLETE"


def test_hostile_cells_are_refused_or_left_out():
    rng = np.random.default_rng(7)
    assert [found for kind in KINDS for _ in range(2) if (found := no_cell_is_trusted(rng, *kind))] == []


def pasted_twice(folder, *kind):
    """The results of a good case, and of the same case with every row of its records there twice."""
    once = reduce_case(good_case(*kind).write(folder))
    case = good_case(*kind)
    for record in case.records.values():
        record.update({name: [*column, *column] for name, column in record.items()})
    return once, reduce_case(case.write(folder))


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in {("M2", ""), ("M3", "two_sample")}])
def test_a_record_that_is_pasted_twice_gives_the_same_result(tmp_path, kind):
    once, twice = pasted_twice(tmp_path, *kind)
    for result in (once, twice):
        for key in ("notes", "rejected"):
            result.pop(key)
        for run in result.get("runs", {}).values():
            run.pop("rejected")
    assert twice == once


def test_equal_rows_of_a_tilt_are_counted_and_left_out(tmp_path):
    case = good_case("M4", "tilt")
    rows = len(case["T_C"])
    record = case.records["tilt"]
    record.update({name: [*column, *column[: rows // 2]] for name, column in record.items()})
    result = reduce_case(case.write(tmp_path))
    assert result["raw_mean_deg"] == reduce_case(good_case("M4", "tilt").write(tmp_path))["raw_mean_deg"]
    assert result["rejected"]["duplicate"] == rows // 2
    assert f"rows left out because they are equal to another: {rows // 2}" in result["notes"]


def test_equal_rows_of_an_inertial_unit_are_told(tmp_path):
    once, twice = pasted_twice(tmp_path, "M2", "")
    assert not any("pasted twice" in note for note in once["notes"])
    rows = len(good_case("M2").records["positions"]["pos"])
    reported = f"positions.csv: rows that are equal to an earlier one in every cell, {rows}; they were not left out"
    assert any(note.startswith(reported) for note in twice["notes"])


def test_equal_rows_of_two_samples_stay_in_their_places_and_are_told(tmp_path):
    once, twice = pasted_twice(tmp_path, "M3", "two_sample")
    assert twice["dvx_mps"] == [*once["dvx_mps"], *once["dvx_mps"]]
    assert twice["notes"] == [
        f"rows that are equal to an earlier one, and reduced as all others: {len(once['dvx_mps'])}"
    ]
