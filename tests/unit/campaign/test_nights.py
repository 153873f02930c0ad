"""Nights with faults, as tasks and as lines on them."""

import shutil

import pytest

from bench.campaign import nights
from bench.campaign.nights import Faults, night_of, play
from bench.campaign.tasks import Result
from bench.errors import InputError
from tests.support.runs import ROOT


@pytest.fixture
def smoke(tmp_path, monkeypatch):
    """The smoke sequence and its bench in folders of a user."""
    monkeypatch.setattr(nights, "isolate", lambda: tmp_path)
    shutil.copytree(ROOT / "config", tmp_path / "bench")
    shutil.copy(ROOT / "sequences" / "smoke.yaml", tmp_path / "mine.yaml")
    monkeypatch.chdir(tmp_path)
    return night_of("mine.yaml", "bench/simulated.yaml", None, ())


def test_files_of_a_user_are_named_by_their_whole_path_and_shipped_ones_by_their_name(smoke, tmp_path):
    assert smoke.sequence == str(tmp_path / "mine.yaml")
    assert smoke.bench == str(tmp_path / "bench" / "simulated.yaml")
    for name in ("smoke", str(ROOT / "sequences" / "smoke.yaml")):
        assert night_of(name, "simulated", None, ()).words == "smoke --bench simulated"
    with pytest.raises(InputError, match="no such"):
        night_of("smole", "simulated", None, ())


def test_a_seed_gives_the_same_night_and_another_seed_another_one(smoke):
    tasks = Faults(smoke, range(3, 5)).tasks(None)
    first, again, other = (play(**task.arguments) for task in (tasks[0], tasks[0], tasks[1]))
    assert first == again
    assert first["digest"] != other["digest"]
    assert first["faults"]
    assert first["wrong"] == []


def test_a_file_that_has_changed_on_the_way_is_refused(smoke, tmp_path):
    (task,) = Faults(smoke, range(1, 2)).tasks(None)
    path = tmp_path / "bench" / "simulated.yaml"
    path.write_text(path.read_text("utf-8") + "\n# edited\n", "utf-8")
    assert Faults(smoke, range(1, 2)).tasks(None)[0].digest != task.digest
    with pytest.raises(InputError, match="has changed"):
        play(**task.arguments)


@pytest.mark.parametrize(
    ("changed", "code", "line"),
    [
        ({}, 0, "each ended as it should"),
        ({"wrong": ["chamber silent: ended with error, which names no cause: "]}, 3, "bench rehearse smoke"),
        ({"wrong": ["x"], "unsafe_without_fault": ["supply"]}, 6, "--faults 7"),
    ],
)
def test_a_night_that_is_not_as_it_should_be_is_told_with_the_command_that_plays_it(tmp_path, changed, code, line):
    campaign = Faults(night_of("smoke", "simulated", None, ("gate=3 s",)), range(7, 8))
    (task,) = campaign.tasks(None)
    content = {"ended": "error", "verdict": "ERROR", "wrong": [], "unsafe_without_fault": [], **changed}
    result = Result(task.key, task.digest, "", content, "", 1.0, "", "")
    lines = "\n".join(campaign.lines(lambda _: result, tmp_path))
    assert line in lines
    assert "1 nights: error, ERROR" in lines
    assert campaign.exit_code(lambda _: result) == code
