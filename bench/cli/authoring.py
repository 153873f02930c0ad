"""schema, fmt, new: commands for writing sequences and bench files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from bench.cli.commands import Command, argument, arguments, flag, option
from bench.cli.exits import INPUT_ERROR, PASS
from bench.cli.streams import say, say_json


def _schema(of: str, target: str) -> Callable[[], None]:
    """Return a command that prints a JSON Schema, which the function `target` returns."""

    def print_schema() -> None:
        from drivers.installed import loaded

        say_json(loaded(target)(), indent=2)

    print_schema.__doc__ = f"Print the JSON Schema of {of}."
    return print_schema


def format_files(files: tuple[Path, ...], *, check: bool) -> int:
    """Format the indentation of YAML files; values, comments and spelling stay unchanged."""
    from bench.config.layout import changes
    from bench.files import atomic_file

    changed = changes(files)
    for path, text in changed.items():
        if not check:
            with atomic_file(path) as draft:
                draft.write_bytes(text.encode())
        say(path)
    return INPUT_ERROR if check and changed else PASS


def new_driver(name: str, kind: str, out: Path) -> None:
    """Write the starter package of a plug-in driver, with simulator and passing tests."""
    from bench.app.new_package import write_driver

    say(*write_driver(name, kind, out))


def new_method(name: str, out: Path) -> None:
    """Write the starter package of a plug-in method, with words, case, truth and passing tests."""
    from bench.app.new_package import write_method

    say(*write_method(name, out))


def new_sequence(name: str, folder: Path) -> None:
    """Write a commented starter sequence that runs on the shipped simulated bench."""
    from bench.sequence.document.starter import write_starter

    say(write_starter(name, folder))


def new_bench(name: str, source: str, folder: Path) -> None:
    """Write a starter bench file: a copy of a similar bench, with the files that it refers to."""
    from bench.config.new_bench import write_bench

    say(*write_bench(name, source, folder))


COMMANDS = (
    Command("schema sequence", _schema("sequence files", "bench.sequence.document.schema:sequence_schema")),
    Command("schema bench", _schema(
        "bench files, with the blocks of every installed driver", "bench.config.schema:bench_schema"
    )),
    Command("schema chamber-profile", _schema(
        "the files that describe a chamber's Modbus registers", "bench.config.schema:chamber_profile_schema"
    )),
    Command("schema scenario", _schema(
        "scenarios, the fault scripts for --scenario", "bench.config.schema:scenario_schema"
    )),
    Command("schema table-profile", _schema(
        "the files that describe the frames of a rate table or a head", "bench.config.schema:table_profile_schema"
    )),
    Command("fmt", format_files, (
        arguments("FILE", "Sequence and bench files.", to="files", least=1, read=Path),
        flag("--check", "Change nothing; exit with 2 if a file would change."),
    )),
    Command("new driver", new_driver, (
        argument("NAME", "The name of the driver, such as my_chamber."),
        option("--kind ROLE", "Kind of device, as in the needs of a sequence.", default="thermal_chamber"),
        option("--out DIR", "Directory for its package.", read=Path, default=Path()),
    )),
    Command("new method", new_method, (
        argument("NAME", "The name of the method, such as my_drift."),
        option("--out DIR", "Directory for its package.", read=Path, default=Path()),
    )),
    Command("new sequence", new_sequence, (
        argument("NAME", "The name of the sequence, such as warm_up."),
        option("--dir DIR", "Directory for the file.", to="folder", read=Path, default=Path("sequences")),
    )),
    Command("new bench", new_bench, (
        argument("NAME", "The name of the bench, such as lab_2."),
        option(
            "--from BENCH", "The bench to copy: a shipped one, or a file.", to="source", default="simulated"
        ),
        option("--dir DIR", "Directory for the file.", to="folder", read=Path, default=Path("config")),
    )),
)  # fmt: skip
