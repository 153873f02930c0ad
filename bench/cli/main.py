"""Main program of the command line `bench`."""

from __future__ import annotations

import codecs
import contextlib
import io
import os
import signal
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence

from bench.cli.commands import Command, Helped
from bench.cli.exits import ABORTED, BENCH_ERROR, INPUT_ERROR
from bench.cli.interrupts import end_at_once
from bench.cli.streams import remark, say
from bench.cli.table import COMMANDS
from bench.errors import BenchError, InputError
from bench.memory import keep_freed_memory
from drivers.errors import DriverError

PURPOSE = "Runs inertial-sensor test benches: sequences in, calibrated models with uncertainties out."
GROUPS = {
    "runs": "List or verify runs.",
    "devices": "List the instruments of a bench, or find new ones.",
    "archive": "Publish runs of several benches, and ask questions to all of them.",
    "campaign": "Do many nights or reductions by several processes or a cluster.",
    "queue": "List or change the queue of the station.",
    "users": "List or change the users of the station.",
    "tokens": "List, make or revoke tokens of programs.",
    "schema": "Print the JSON Schema of a kind of file.",
    "new": "Write a starter file.",
}
ESCAPED = "bench-escaped"  # error handler of encoders: writes \u00b0 for °, which is also valid in JSON


def run() -> None:
    """Run the command line; exit codes are those of `bench.cli.exits`."""
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # searching all packages for plug-ins is slow
    os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", "4")  # idle threads of numpy would spin for 50 ms
    keep_freed_memory()
    make_usable()
    if sys.argv[1:2] in (["run"], ["rehearse"], ["attempt"]):
        end_at_once()
    code = main(sys.argv[1:])
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
        signal.signal(number, signal.SIG_IGN)  # the outcome is decided
    if "deltalake" in sys.modules:  # its threads abort the process now and then while Python ends, whatever the outcome
        with contextlib.suppress(OSError, ValueError):
            sys.stderr.flush()
        os._exit(code)
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
        remark("a module tried to end this program:", traceback.format_exc().rstrip())
        return BENCH_ERROR
    except InputError as problem:
        remark(problem)
        return INPUT_ERROR
    except (BenchError, DriverError) as problem:
        remark(problem)
        return BENCH_ERROR
    except KeyboardInterrupt:
        remark("interrupted")
        return ABORTED
    except BrokenPipeError:
        sys.stderr.close()  # the reader of our output has closed the pipe
        return BENCH_ERROR
    except OSError as problem:
        remark(f"{problem.filename or 'standard output'}: {problem.strerror or problem}")
        return BENCH_ERROR
    except Exception:  # noqa: BLE001  Python would exit with 1, which means that the unit failed
        remark("an internal error of this program:", traceback.format_exc().rstrip())
        return BENCH_ERROR


def _done(words: Sequence[str]) -> int:
    first, *others = words or ["--help"]
    if first in ("--help", "-h", "help"):
        say(f"Usage: bench COMMAND ...\n\n{PURPOSE}\n\n{_listed('')}\n'bench COMMAND --help' has more.")
        return 0 if words else INPUT_ERROR
    if first == "--version":
        from importlib.metadata import version

        say(f"inertial-test-bench {version('inertial-test-bench')}")
        return 0
    if first not in GROUPS:
        return _command(first, COMMANDS).called(others)
    if not others or others[0].startswith("-"):
        return _of_group(first, others)
    return _command(f"{first} {others[0]}", COMMANDS).called(others[1:])


def _command(name: str, known: Mapping[str, Command]) -> Command:
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


def make_usable() -> None:
    """Open closed standard streams on the null device; escape characters that their encoding lacks.

    Otherwise the next opened file, such as the run database, would get the descriptor of a closed stream, and output of
    libraries and child processes would be written into it.
    """
    codecs.register_error(ESCAPED, _escaped)
    if sys.stdin is None:
        sys.stdin = _null("r")
    if sys.stdout is None:
        sys.stdout = _null("w")
    if sys.stderr is None:
        sys.stderr = _null("w")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=ESCAPED)


def _null(mode: str) -> io.TextIOWrapper:
    """Open the null device on the lowest free descriptor: that of the closed stream."""
    number = os.open(os.devnull, os.O_RDWR)
    os.set_inheritable(number, True)
    raw = io.FileIO(number, mode, closefd=False)
    return io.TextIOWrapper(io.BufferedReader(raw) if mode == "r" else io.BufferedWriter(raw), encoding="utf-8")


def _escaped(problem: UnicodeError) -> tuple[str, int]:
    if not isinstance(problem, UnicodeEncodeError):
        raise problem
    units = problem.object[problem.start : problem.end].encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{units[at]:02x}{units[at + 1]:02x}" for at in range(0, len(units), 2)), problem.end
