"""schema, fmt, new: commands for writing sequences and bench files."""

from __future__ import annotations

from pathlib import Path

from bench.cli.commands import Command, argument, arguments, flag, option
from bench.cli.exits import INPUT_ERROR, PASS
from bench.cli.streams import say, say_json


def schema_of_sequences() -> None:
    """Print the JSON Schema of sequence files."""
    from bench.sequence.document.schema import sequence_schema

    say_json(sequence_schema(), indent=2)


def schema_of_benches() -> None:
    """Print the JSON Schema of bench files, with the blocks of every installed driver."""
    from bench.config.schema import bench_schema

    say_json(bench_schema(), indent=2)


def schema_of_chamber_profiles() -> None:
    """Print the JSON Schema of the files that describe a chamber's Modbus registers."""
    from bench.config.schema import chamber_profile_schema

    say_json(chamber_profile_schema(), indent=2)


def schema_of_scenarios() -> None:
    """Print the JSON Schema of scenarios, the fault scripts for --scenario."""
    from bench.config.schema import scenario_schema

    say_json(scenario_schema(), indent=2)


def schema_of_table_profiles() -> None:
    """Print the JSON Schema of the files that describe the frames of a rate table or a head."""
    from bench.config.schema import table_profile_schema

    say_json(table_profile_schema(), indent=2)


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
    Command("schema sequence", schema_of_sequences),
    Command("schema bench", schema_of_benches),
    Command("schema chamber-profile", schema_of_chamber_profiles),
    Command("schema scenario", schema_of_scenarios),
    Command("schema table-profile", schema_of_table_profiles),
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
