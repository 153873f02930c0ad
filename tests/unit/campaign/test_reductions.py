"""What the reductions of all runs of an archive tell."""

import csv
import shutil
from dataclasses import replace

import pytest

from bench.archive.destination import Destination
from bench.archive.publish import push
from bench.archive.query import opened
from bench.campaign import reductions
from bench.campaign.isolation import isolate
from bench.campaign.program import present
from bench.campaign.reductions import CHANGES, Reductions, is_shown, reduce_again
from bench.campaign.tasks import Result
from bench.errors import InputError
from bench.reduce import stored_run
from tests.support.runs import run_short


def finding(value=1.0, u=0.1, unit="g", verdict="PASS"):
    return {"value": value, "u": u, "unit": unit, "verdict": verdict}


@pytest.mark.parametrize(
    ("before", "now", "shown"),
    [
        (finding(), finding(value=1.0099), False),
        (finding(), finding(value=1.0101), True),
        (finding(), finding(value=0.9899), True),
        (finding(value=-1.0), finding(value=-1.0101), True),
        (finding(), finding(u=0.1099), False),
        (finding(), finding(u=0.0899), True),
        (finding(), finding(verdict="FAIL"), True),
        (finding(), finding(verdict=None), True),
        (finding(), finding(unit="m/s2"), True),
        (finding(), None, True),
        (None, finding(), True),
        (finding(u=0.0), finding(u=0.0, value=1.0 + 1e-12), True),
    ],
)
def test_changes_are_shown_from_a_tenth_of_u(before, now, shown):
    assert is_shown({"id": "a", "before": before, "now": now}) is shown


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """An archive with two runs."""
    folder = tmp_path_factory.mktemp("archive")
    for seed in (1, 2):
        run = run_short(folder / "runs", sequence="smoke", seed=seed)
        push(run.path, Destination(str(folder / "kept")))
    return folder / "kept"


@pytest.fixture
def isolated(monkeypatch, tmp_path):
    """A folder for the files of a worker."""
    monkeypatch.setattr(reductions, "isolate", lambda: tmp_path)
    isolate.cache_clear()
    reductions._opened.cache_clear()
    yield
    reductions._opened.cache_clear()


def shown(campaign, folder, contents):
    """Lines on results, and the rows of the file."""
    results = {
        task.digest: Result(task.key, task.digest, "", content, "", 1.0, "", "")
        for task, content in zip(campaign.tasks(None), contents, strict=True)
    }
    lines = list(campaign.lines(lambda task: results.get(task.digest), folder))
    with (folder / CHANGES).open(encoding="utf-8", newline="") as file:
        return lines, list(csv.reader(file))[1:]


def of_another_program(monkeypatch):
    """From now on every value comes out 0.2 u higher."""
    honest = stored_run.evaluate

    def shifted(*given):
        found = honest(*given)
        units = [
            replace(unit, findings=[replace(each, value=each.value + 0.2 * each.u) for each in unit.findings])
            for unit in found.units
        ]
        return replace(found, units=units)

    monkeypatch.setattr(stored_run, "evaluate", shifted)


@pytest.mark.usefixtures("isolated")
def test_the_present_program_changes_nothing_and_another_one_is_seen(archive, tmp_path, monkeypatch):
    campaign = Reductions(str(archive))
    tasks = campaign.tasks(None)
    assert len(tasks) == 2
    lines, rows = shown(campaign, tmp_path, [reduce_again(**task.arguments) for task in tasks])
    assert rows == []
    assert lines[-1].startswith("reduce: 2 runs with ")
    assert lines[-1].endswith("0 changes below 0.1 u, 0 changed verdicts of runs, 0 new versions")

    of_another_program(monkeypatch)
    contents = [reduce_again(**task.arguments) for task in tasks]
    lines, rows = shown(campaign, tmp_path, contents)
    assert len(rows) == sum(len(content["changes"]) for content in contents) > 2
    assert {row[5] for row in rows} == {"+0.2"}
    assert "value before" in lines[0]


@pytest.mark.usefixtures("isolated")
def test_changed_results_become_versions_and_the_repeated_command_has_the_same_tasks(archive, tmp_path, monkeypatch):
    copy = str(shutil.copytree(archive, tmp_path / "copy"))
    of_another_program(monkeypatch)
    tasks = Reductions(copy, publish=True).tasks(None)
    assert [reduce_again(**task.arguments)["published"] for task in tasks] == [2, 2]
    assert opened(copy).query("SELECT version, reduced_by FROM runs").rows == 2 * [(2, present())]
    assert [task.digest for task in Reductions(copy, publish=True).tasks(None)] == [task.digest for task in tasks]
    assert [reduce_again(**task.arguments)["published"] for task in tasks] == [2, 2]
    assert opened(copy).query("SELECT count(*) FROM all_runs").rows == [(4,)]


def test_a_folder_without_an_archive_is_refused(tmp_path):
    with pytest.raises(InputError):
        Reductions(str(tmp_path))
