"""What is given twice on a command line is refused; the last would else take the place of the first without a word."""

import itertools
from collections.abc import Iterator
from typing import Any

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from bench.cli.main import app
from tests.support.sequences import ROOT


def commands(command: Any = None, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    command = command or get_command(app)
    for name, each in getattr(command, "commands", {}).items():
        yield from commands(each, (*path, name))
    if not hasattr(command, "commands"):
        yield path, command


def options() -> Iterator[tuple[Any, Any]]:
    for _, command in commands():
        yield from ((command, each) for each in command.params if each.param_type_name == "option")


def invoked(*args: str) -> tuple[int, str]:
    done = CliRunner().invoke(app, args)
    return done.exit_code, " ".join(done.output.split()) + str(done.exception or "")


def test_every_option_with_one_value_is_refused_a_second_time():
    tried = 0
    for command, option in options():
        if option.multiple or (option.is_flag and not option.secondary_opts):
            continue
        once = [option.opts[0]] if option.is_flag else [option.opts[0], "x"]
        with pytest.raises(Exception, match="is given 2 times") as refused:
            command.make_context(command.name, [*once, *once])
        assert refused.value.exit_code == 2, (command.name, option.opts)
        tried += 1
    assert tried > 60


def test_flags_that_say_the_same_and_options_for_several_may_be_given_again():
    bench = str(ROOT / "config/indexing.yaml")
    wishes = ("--set", "step=0.1°", "--set", "largest=0.4°")
    assert invoked("check", "indexing_static", "--bench", bench, "--strict", "--strict", *wishes)[0] == 0
    assert any(option.multiple for _, option in options())


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
    _, told = invoked(*args)
    assert words in told
