"""Main program of the command line `bench`."""

from __future__ import annotations

import os
import signal
import sys
import traceback
from collections.abc import Iterator, Sequence

from bench.cli import (
    authoring,
    control,
    devices,
    offline,
    people,
    queueing,
    rehearsing,
    running,
    station,
    stored,
    watching,
)
from bench.cli.commands import COMMANDS, Command, Helped
from bench.cli.exits import ABORTED, BENCH_ERROR, INPUT_ERROR
from bench.cli.interrupts import end_at_once
from bench.cli.streams import make_usable
from bench.errors import BenchError, InputError
from drivers.errors import DriverError

PURPOSE = "Runs inertial-sensor test benches: sequences in, calibrated models with uncertainties out."
ALL = (
    *running.COMMANDS, *rehearsing.COMMANDS, *stored.COMMANDS, *devices.COMMANDS, *offline.COMMANDS,
    *authoring.COMMANDS, *control.COMMANDS, *station.COMMANDS, *queueing.COMMANDS,
    *watching.COMMANDS, *people.COMMANDS,
)  # fmt: skip
COMMANDS.update({command.words: command for command in ALL})
GROUPS = {
    "runs": "List or verify runs.",
    "devices": "List the instruments of a bench, or find new ones.",
    "queue": "List or change the queue of the station.",
    "users": "List or change the users of the station.",
    "tokens": "List, make or revoke tokens of programs.",
    "schema": "Print the JSON Schema of a kind of file.",
    "new": "Write a starter file.",
}


def run() -> None:
    """Run the command line; exit codes are those of `bench.cli.exits`."""
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # searching all packages for plug-ins is slow
    make_usable()
    if sys.argv[1:2] in (["run"], ["rehearse"], ["attempt"]):
        end_at_once()
    code = main(sys.argv[1:])
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
        signal.signal(number, signal.SIG_IGN)  # the outcome is decided
    sys.exit(code)


def main(words: Sequence[str]) -> int:
    """Run the command of these words; return its exit code and print problems on stderr."""
    try:
        code = _done(words)
        sys.stdout.flush()
        return code
    except Helped:
        return 0
    except SystemExit:  # raised by a plug-in or another module; its code would pass for ours
        _say("a module tried to end this program:\n" + traceback.format_exc())
        return BENCH_ERROR
    except InputError as problem:
        _say(str(problem))
        return INPUT_ERROR
    except (BenchError, DriverError) as problem:
        _say(str(problem))
        return BENCH_ERROR
    except KeyboardInterrupt:
        _say("interrupted")
        return ABORTED
    except BrokenPipeError:
        sys.stderr.close()  # the reader of our output has closed the pipe
        return BENCH_ERROR
    except OSError as problem:
        _say(f"{problem.filename or 'standard output'}: {problem.strerror or problem}")
        return BENCH_ERROR
    except Exception:  # noqa: BLE001  Python would exit with 1, which means that the unit failed
        _say("an internal error of this program:\n" + traceback.format_exc())
        return BENCH_ERROR


def _done(words: Sequence[str]) -> int:
    first, *others = words or ["--help"]
    if first in ("--help", "-h", "help"):
        sys.stdout.write(f"Usage: bench COMMAND ...\n\n{PURPOSE}\n\n{_listed('')}\n'bench COMMAND --help' has more.\n")
        return 0 if words else INPUT_ERROR
    if first == "--version":
        from importlib.metadata import version

        sys.stdout.write(f"inertial-test-bench {version('inertial-test-bench')}\n")
        return 0
    if first not in GROUPS:
        return _command(first, COMMANDS).called(others)
    if not others or others[0].startswith("-"):
        return _of_group(first, others)
    return _command(f"{first} {others[0]}", COMMANDS).called(others[1:])


def _command(name: str, known: dict[str, Command]) -> Command:
    """Return the command of that name. Raises InputError."""
    if name not in known:
        from drivers.schema.suggest import nearest

        close = nearest(name, [*known, *GROUPS, "--help", "--version"])
        raise InputError(
            f"there is no command 'bench {name}'; "
            + (f"did you mean 'bench {close}'?" if close else "'bench --help' lists all commands")
        )
    return known[name]


def _of_group(group: str, options: Sequence[str]) -> int:
    """Run the command of a group without a further word if there is one; otherwise list its commands."""
    if group in COMMANDS:
        return COMMANDS[group].called(options, _listed(f"{group} "))
    sys.stdout.write(f"Usage: bench {group} COMMAND ...\n\n{GROUPS[group]}\n\n{_listed(f'{group} ')}")
    return 0 if options in (["--help"], ["-h"]) else INPUT_ERROR


def _listed(group: str) -> str:
    """Return one line for each command of a group, or for each top-level name."""
    rows = dict(_rows(group))
    width = max(map(len, rows))
    return "Commands:\n" + "".join(f"  {name:{width}}  {text}\n" for name, text in rows.items())


def _rows(group: str) -> Iterator[tuple[str, str]]:
    for words, command in COMMANDS.items():
        if not words.startswith(group) or words == group.strip():
            continue
        first = words.removeprefix(group).partition(" ")[0]
        yield first, command.help.partition("\n")[0] if group or first not in GROUPS else GROUPS[first]


def _say(text: str) -> None:
    sys.stderr.write(text.rstrip("\n") + "\n")
