"""The command `bench`."""

from __future__ import annotations

import signal
import sys
import traceback
from copy import copy
from typing import Annotated

import typer
from typer.models import CommandInfo

from bench.cli import authoring, control, devices, offline, rehearsing, running, stored
from bench.cli.exits import ABORTED, BENCH_ERROR, INPUT_ERROR
from bench.cli.once import each_option_once
from bench.errors import BenchError, InputError
from drivers.errors import DriverError

INTERRUPTED = 130  # what typer makes of Ctrl-C


def _print_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        sys.stdout.write(f"inertial-test-bench {version('inertial-test-bench')}\n")
        raise typer.Exit


app = typer.Typer(
    name="bench",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


@app.callback()
def program(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version, and exit.", is_eager=True, callback=_print_version)
    ] = False,
) -> None:
    """Runs inertial-sensor test benches: sequences in, calibrated models with uncertainties out."""


running.register(app)
rehearsing.register(app)
stored.register(app)
devices.register(app)
offline.register(app)
authoring.register(app)
control.register(app)
each_option_once(app)


def run() -> None:
    """Entry point; the exit codes are those of `bench.cli.exits`."""
    try:
        _asked_for(sys.argv[1:2])()
    except SystemExit as ending:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
            signal.signal(number, signal.SIG_IGN)  # how it ended is decided
        sys.exit(ABORTED if ending.code == INTERRUPTED else ending.code)
    except InputError as problem:
        _say(str(problem))
        sys.exit(INPUT_ERROR)
    except (BenchError, DriverError) as problem:
        _say(str(problem))
        sys.exit(BENCH_ERROR)
    except KeyboardInterrupt:
        _say("interrupted")
        sys.exit(ABORTED)
    except BrokenPipeError:
        sys.stderr.close()  # whoever read us has enough
        sys.exit(BENCH_ERROR)
    except Exception:  # noqa: BLE001  Python would exit with 1, which says that the unit failed
        _say("an internal error of this program:\n" + traceback.format_exc())
        sys.exit(BENCH_ERROR)


def _asked_for(first: list[str]) -> typer.Typer:
    """The program with the command alone that the first argument names, or whole where it names none.

    Typer reads the signatures of all commands that a program has, which takes longer than some commands do.
    """
    short = copy(app)
    short.registered_commands = [each for each in app.registered_commands if _name_of(each) in first]
    short.registered_groups = [each for each in app.registered_groups if each.name in first]
    return short if short.registered_commands or short.registered_groups else app


def _name_of(command: CommandInfo) -> str:
    return command.name or (command.callback.__name__ if command.callback is not None else "")


def _say(text: str) -> None:
    sys.stderr.write(text.rstrip("\n") + "\n")
