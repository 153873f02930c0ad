"""schema, reference, fmt, new: what helps to write sequences and bench files."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from bench.cli.exits import INPUT_ERROR

schemas = typer.Typer(help="Print the JSON Schema of a kind of file.", no_args_is_help=True, rich_markup_mode=None)
starters = typer.Typer(help="Write a starter file.", no_args_is_help=True, rich_markup_mode=None)


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.add_typer(schemas, name="schema")
    app.command()(reference)
    app.command("fmt")(format_files)
    app.add_typer(starters, name="new")


@schemas.command("sequence")
def schema_of_sequences() -> None:
    """Print the JSON Schema of sequence files."""
    from bench.sequence.schema import sequence_schema

    _print(sequence_schema())


@schemas.command("bench")
def schema_of_benches() -> None:
    """Print the JSON Schema of bench files, with the blocks of every installed driver."""
    from bench.config.schema import bench_schema

    _print(bench_schema())


@schemas.command("chamber-profile")
def schema_of_chamber_profiles() -> None:
    """Print the JSON Schema of the files that describe a chamber's Modbus registers."""
    from bench.config.schema import chamber_profile_schema

    _print(chamber_profile_schema())


@schemas.command("scenario")
def schema_of_scenarios() -> None:
    """Print the JSON Schema of scenarios, the files of faults that --scenario takes."""
    from bench.config.schema import scenario_schema

    _print(scenario_schema())


@schemas.command("table-profile")
def schema_of_table_profiles() -> None:
    """Print the JSON Schema of the files that describe the frames of a rate table or a head."""
    from bench.config.schema import table_profile_schema

    _print(table_profile_schema())


def _print(schema: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(schema, ensure_ascii=False, indent=2) + "\n")


def reference(
    page: Annotated[str, typer.Argument(metavar="PAGE", help="One of the pages listed by README.")] = "README",
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Write all pages there instead of printing one.")
    ] = None,
) -> None:
    """Print a page of the reference in Markdown: steps, keys of files, methods, drivers, commands, errors."""
    from bench.cli.reference import page_text, write_pages

    if out is None:
        sys.stdout.write(page_text(page))
        return
    for path in write_pages(out):
        sys.stdout.write(f"{path}\n")


def format_files(
    files: Annotated[list[Path], typer.Argument(metavar="FILE…", help="Sequence and bench files.")],
    check: Annotated[bool, typer.Option("--check", help="Change nothing; exit with 2 if a file would change.")] = False,
) -> None:
    """Indent YAML files as the shipped ones are; values, comments and spelling stay."""
    from bench.config.layout import changes
    from bench.files import written_whole

    changed = changes(files)
    for path, text in changed.items():
        if not check:
            with written_whole(path) as draft:
                draft.write_bytes(text.encode())
        sys.stdout.write(f"{path}\n")
    if check and changed:
        raise typer.Exit(INPUT_ERROR)


@starters.command("driver")
def new_driver(
    name: Annotated[str, typer.Argument(metavar="NAME", help="The name of the driver, such as my_chamber.")],
    kind: Annotated[
        str, typer.Option(metavar="ROLE", help="Kind of device, as in the needs of a sequence.")
    ] = "thermal_chamber",
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Directory for its package.")] = Path(),
) -> None:
    """Write a driver of a plug-in's own, with simulator and tests, that works as it is, to start from."""
    from bench.app.new_driver import write_driver

    for path in write_driver(name, kind, out):
        sys.stdout.write(f"{path}\n")


@starters.command("sequence")
def new_sequence(
    name: Annotated[str, typer.Argument(metavar="NAME", help="The name of the sequence, such as warm_up.")],
    folder: Annotated[Path, typer.Option("--dir", metavar="DIR", help="Directory for the file.")] = Path("sequences"),
) -> None:
    """Write a commented sequence that runs on the shipped simulated bench, to start from."""
    from bench.sequence.starter import write_starter

    sys.stdout.write(f"{write_starter(name, folder)}\n")


@starters.command("bench")
def new_bench(
    name: Annotated[str, typer.Argument(metavar="NAME", help="The name of the bench, such as lab_2.")],
    source: Annotated[
        str, typer.Option("--from", metavar="BENCH", help="The bench to copy: a shipped one, or a file.")
    ] = "simulated",
    folder: Annotated[Path, typer.Option("--dir", metavar="DIR", help="Directory for the file.")] = Path("config"),
) -> None:
    """Write a bench file to start from: a copy of one that is like yours, with the files that it names."""
    from bench.config.new_bench import write_bench

    for path in write_bench(name, source, folder):
        sys.stdout.write(f"{path}\n")
