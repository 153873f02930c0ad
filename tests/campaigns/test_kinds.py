"""Kinds of `bench campaign` that need the sources: their tasks, and what they tell of results."""

import re

import pytest

from bench.campaign import kinds
from bench.campaign.kinds import of_sources
from bench.campaign.tasks import Result
from bench.errors import InputError
from campaigns.kinds import commands, monte_carlo, truth, wires
from campaigns.truth.campaign import Comparison
from campaigns.truth.cells import RECORDS, WIRES, Line

ALL = {"parts": (), "methods": (), "kinds": (), "forms": (), "levels": (), "seeds": 40, "decide": 400, "block": 40}


def of_truth(**options):
    return truth.campaign(**{**ALL, "figures": False, **options})


def known_by(contents):
    """The results of tasks with these contents, by key."""

    def known(task):
        if task.key not in contents:
            return None
        return Result(task.key, task.digest, "", contents[task.key], "", 1.0, "", "")

    return known


NOTHING = known_by({})


def lines(task, error_u):
    """Seeds of a cell whose error is so many u, with alternating signs."""
    first, count = task.arguments["first"], task.arguments["count"]
    return [
        Line(seed, (Comparison(seed, 0, "K0", (-1) ** seed * error_u, 0.0, 1.0),)).to_json()
        for seed in range(first, first + count)
    ]


@pytest.mark.parametrize(
    "campaign",
    [of_truth(), monte_carlo.campaign(trials=(), draws=1500), wires.campaign(trials=20000)],
    ids=lambda c: c.name,
)
def test_tasks_are_the_same_each_time_and_differ_from_each_other(campaign):
    digests = [task.digest for task in campaign.tasks(NOTHING)]
    assert len(digests) == len(set(digests)) > 20
    assert [task.digest for task in campaign.tasks(NOTHING)] == digests


def test_more_seeds_use_the_blocks_that_are_there():
    some = of_truth(methods=("M4a",), levels=(RECORDS,), seeds=40, block=20)
    more = of_truth(methods=("M4a",), levels=(RECORDS,), seeds=60, block=20)
    few, many = ({task.digest for task in each.tasks(NOTHING)} for each in (some, more))
    assert few < many


def test_a_cell_beyond_its_bars_is_decided_by_fresh_seeds():
    campaign = of_truth(
        methods=("M4a",), kinds=("as shipped",), forms=("normal",), levels=(RECORDS,), seeds=8, decide=20
    )
    first = campaign.tasks(NOTHING)
    assert len(first) == 1
    bad = {task.key: lines(task, 2.0) for task in first}
    wanted = campaign.tasks(known_by(bad))
    assert len(wanted) == 2
    assert wanted[1].arguments["count"] == 20
    assert campaign.exit_code(known_by(bad)) == 1
    fresh = wanted[1]
    for error_u, code in ((1.0, 0), (2.0, 1)):
        known = known_by(bad | {fresh.key: lines(fresh, error_u)})
        assert campaign.tasks(known) == wanted
        assert campaign.exit_code(known) == code
        told = "\n".join(campaign.lines(known, None))
        assert ("1 cells FAILED" in told) == bool(code)
        assert "20 records" in told


def test_a_cell_within_its_bars_needs_no_fresh_seeds():
    campaign = of_truth(
        methods=("M4a",), kinds=("as shipped",), forms=("normal",), levels=(RECORDS,), seeds=8, decide=20
    )
    good = {task.key: lines(task, 1.0) for task in campaign.tasks(NOTHING)}
    assert len(campaign.tasks(known_by(good))) == 1
    assert campaign.exit_code(known_by(good)) == 0


def test_without_a_choice_all_parts_are_wanted_and_a_choice_is_of_cells():
    assert {task.key for task in of_truth().tasks(NOTHING)} >= {f"command {name}" for name in truth.COMMANDS}
    assert not of_truth(levels=(WIRES,)).commands
    assert not of_truth(parts=("ramp",)).cells


@pytest.mark.parametrize(
    "wrong",
    [{"parts": ("rams",)}, {"methods": ("M4",)}, {"kinds": ("warmer",)}, {"forms": ("norml",)}, {"levels": ("wire",)}],
)
def test_an_unknown_choice_is_named(wrong):
    (name,) = (*(each for each in wrong.values()),)
    with pytest.raises(InputError, match=f"{name[0]}: unknown, expected"):
        of_truth(**wrong)
    with pytest.raises(InputError, match="unknown, expected"):
        monte_carlo.campaign(trials=("threshold",), draws=10)


def test_a_command_that_fails_fails_the_campaign(tmp_path):
    campaign = of_truth(parts=("ladder",))
    (task,) = campaign.tasks(NOTHING)
    for status, code in ((0, 0), (1, 1)):
        known = known_by({task.key: {"status": status, "printed": ["as it was"]}})
        assert campaign.exit_code(known) == code
        assert "as it was" in list(campaign.lines(known, tmp_path))


def test_a_command_is_run_with_its_options():
    found = commands.run(["truth.units", "--table", "--records", "/nowhere", "--method", "M4a"])
    assert found == {"status": 0, "printed": ["truth on altered units: ok"]}


def test_a_command_that_cannot_be_run_is_no_result():
    with pytest.raises(RuntimeError, match=r"ended with 2: .*--no-such-option"):
        commands.run(["truth.units", "--no-such-option"])


def test_blocks_of_draws_are_other_draws_and_add_up():
    campaign = monte_carlo.campaign(trials=("thresholds",), draws=150)
    tasks = campaign.tasks(NOTHING)
    assert [task.arguments["count"] for task in tasks] == [100, 50]
    small = [{**task.arguments, "count": 4} for task in tasks]
    contents = [monte_carlo.drawn(**each) for each in small]
    assert contents[0] == monte_carlo.drawn(**small[0])
    assert contents[0] != contents[1]
    sums = [monte_carlo.Sums(*each["threshold"]) for each in contents]
    known = known_by({task.key: content for task, content in zip(tasks, contents, strict=True)})
    told = "\n".join(campaign.lines(known, None))
    assert f"scatter/u {(sums[0] + sums[1]).ratio:6.3f}" in told
    assert (sums[0] + sums[1]).values == 4


@pytest.mark.parametrize(("ratio", "code"), [(1.0, 0), (1.09, 0), (1.11, 1), (0.89, 1)])
def test_scatter_must_be_within_ten_percent_of_u(ratio, code):
    campaign = monte_carlo.campaign(trials=("thresholds",), draws=100)
    (task,) = campaign.tasks(NOTHING)
    known = known_by({task.key: {"threshold": [100, 100 * ratio**2, 100.0]}})
    assert campaign.exit_code(known) == code
    assert bool(re.search("thresholds: threshold", "\n".join(campaign.lines(known, None)))) == bool(code)


def test_what_must_not_happen_on_a_wire_fails_the_campaign():
    campaign = wires.campaign(trials=100)
    content = {"of": "orders", "outcomes": {"done": 3}, "unexpected": []}
    fine = {task.key: content for task in campaign.tasks(NOTHING)}
    assert campaign.exit_code(known_by(fine)) == 0
    bad = fine | {"orders to cts": {**content, "unexpected": ["sent twice"]}}
    assert campaign.exit_code(known_by(bad)) == 1
    told = list(campaign.lines(known_by(bad), None))
    assert "    sent twice" in told
    assert told[-1] == "wires: 1 UNEXPECTED"


def test_without_the_sources_there_is_advice(monkeypatch, tmp_path):
    monkeypatch.setattr(kinds, "ROOT", tmp_path)
    with pytest.raises(InputError, match=r"bench campaign monte-carlo: is for the sources .*make setup"):
        of_sources("monte_carlo")
    (tmp_path / "campaigns" / "kinds").mkdir(parents=True)
    with pytest.raises(InputError, match="'bench' is in"):
        of_sources("monte_carlo")


def test_a_kind_is_found_in_the_sources():
    assert of_sources("wires", trials=100).tasks(NOTHING)
