"""The command `bench`."""

from __future__ import annotations

import sys
import traceback

import typer

from bench.cli import authoring, control, devices, offline, rehearsing, running, stored
from bench.cli.exits import ABORTED, BENCH_ERROR, INPUT_ERROR
from bench.errors import BenchError, InputError
from drivers.errors import DriverError

app = typer.Typer(
    name="bench",
    help="Runs inertial-sensor test benches: sequences in, calibrated models with uncertainties out.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
running.register(app)
rehearsing.register(app)
stored.register(app)
devices.register(app)
offline.register(app)
authoring.register(app)
control.register(app)


def run() -> None:
    """Entry point. Exit 0 pass, 1 verdict FAIL, 2 bad input, 3 bench error, 4 aborted."""
    try:
        app()
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
        _say("a mistake of this program:\n" + traceback.format_exc())
        sys.exit(BENCH_ERROR)


def _say(text: str) -> None:
    sys.stderr.write(text.rstrip("\n") + "\n")
