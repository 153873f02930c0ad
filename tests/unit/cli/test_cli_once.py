"""The command line: every command takes what its function needs, and what is given twice is refused."""

import inspect
import itertools

import pytest

from bench.app.request import RunRequest
from bench.cli.campaign import CLUSTER
from bench.cli.commands import Argument, Command
from bench.cli.table import ALL, COMMANDS
from bench.station.queue.items import Submission
from tests.support.commands import invoked
from tests.support.sequences import ROOT


def given(argument: Argument) -> list[str]:
    """An option with a value that it takes, or an argument."""
    value = next(iter(argument.settings.get("choices") or ["1"]))
    return [argument.name, value] if argument.name.startswith("-") else [value]


def test_every_command_gives_its_function_what_that_takes():
    several = {
        "wishes": set(RunRequest._fields), "submission": set(Submission.model_fields),
        "cluster": {each.parameter for each in CLUSTER},
    }  # fmt: skip
    for command in ALL:
        takes = inspect.signature(command.do).parameters
        gives = {each.parameter for each in command.arguments}
        collected = set().union(*(fields for name, fields in several.items() if name in takes)) - set(takes)
        assert gives - collected == set(takes) - set(several), command.words
    assert len(COMMANDS) == len(ALL) > 30


@pytest.mark.parametrize("command", ALL, ids=lambda command: command.words)
def test_every_option_with_one_value_is_refused_a_second_time(command: Command):
    required = list(itertools.chain(*(given(each) for each in command.arguments if each.is_required)))
    for option in command.arguments:
        if option.once:
            again = given(option) if option.is_required else 2 * given(option)
            done = invoked(*command.words.split(), *required, *again)
            assert done.returncode == 2
            assert f"{option.name} is given 2 times; only the last would count. Give it once." in done.stderr


def test_some_options_take_one_value_and_some_take_several():
    every = [each for command in ALL for each in command.arguments if each.name.startswith("--")]
    assert sum(each.once for each in every) > 60
    assert {each.name for each in every if each.settings["action"] == "append" and not each.once} == {
        "--set", "--alert-route", "--calibration", "--uut", "--unit", "--driver", "--name", "--bench", "--scope",
        "--at-start", "--part", "--method", "--form", "--level", "--only",
    }  # fmt: skip


@pytest.mark.parametrize("command", ALL, ids=lambda command: command.words)
def test_every_command_has_help(command: Command):
    done = invoked(*command.words.split(), "--help")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"usage: bench {command.words} ")
    for each in command.arguments:
        assert each.words.rstrip(".") in " ".join(done.stdout.split())


def test_flags_that_say_the_same_and_options_for_several_may_be_given_again():
    bench = str(ROOT / "config/indexing.yaml")
    options = ("--set", "step=0.1°", "--set", "largest=0.4°")
    assert invoked("check", "indexing_static", "--bench", bench, "--strict", "--strict", *options).returncode == 0


@pytest.mark.parametrize(
    ("args", "bench"),
    [
        (("check", "--bench", "simulated", "smoke"), 0),
        (("check", "smoke", "--bench=simulated"), 0),
        (("check", "smoke", "--ben", "simulated"), 2),  # no option is abbreviated: a later one may begin likewise
        (("--version",), 0),
        (("schema", "--help"), 0),
        (("schema",), 2),
        ((), 2),
    ],
)
def test_words_are_taken_in_any_order_and_whole(args, bench):
    assert invoked(*args).returncode == bench


def test_the_environment_names_the_bench_where_no_option_does(monkeypatch):
    monkeypatch.setenv("BENCH_FILE", "indexing")
    assert "config/indexing.yaml" in invoked("check", "indexing_static").stdout
    assert "config/simulated.yaml" in invoked("check", "smoke", "--bench", "simulated").stdout
    monkeypatch.setenv("BENCH_FILE", "")
    assert "config/simulated.yaml" in invoked("check", "smoke").stdout


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("check", "indexing_static", "--bench", "config/indexing.yaml", "--set", "step=0.1°", "--set", "step=0.25°"),
         "--set step=0.25°: 'step' is set twice"),
        (("run", "smoke", "--bench", "config/three_units.yaml", "--uut", "a=X", "--uut", "a=Y"),
         "--uut a=Y: place 'a' has 'X' already"),
        (("check", "imu_start_up", "--bench", "config/imu.yaml",
          *itertools.chain(*[("--calibration", "config/uut/imu_calibration.json")] * 2)),
         "has config/uut/imu_calibration.json already"),
    ],
)  # fmt: skip
def test_what_an_option_for_several_names_twice_is_refused(args, words, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert words in invoked(*args).stderr
