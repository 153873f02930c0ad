"""Reference pages: those generated from the models, and the page on commands, which only this layer knows."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import partial
from pathlib import Path

from bench.app.reference.benches import bench_page, drivers_page
from bench.app.reference.keys import Blocks, table
from bench.app.reference.problems import errors_page, rules_page
from bench.app.reference.sequences import methods_page, sequence_page, steps_page
from bench.cli.commands import Argument, Command
from bench.cli.exits import MEANINGS
from bench.errors import InputError
from bench.files import atomic_file
from bench.station.mqtt.reference import mqtt_page
from drivers.schema.suggest import did_you_mean

INDEX, COMMANDS_PAGE = "README", "commands"


def index_page() -> Blocks:
    """List of pages."""
    rows = ((f"[{name}]({name}.md)", inspect.getdoc(page) or "") for name, page in PAGES.items() if name != INDEX)
    return [
        "# Reference",
        "Contents of files, options of the command line, and answers of the program. These pages are "
        "generated from the program: `bench reference PAGE` prints one of them, including installed plug-ins, and "
        "`bench reference --out docs/reference` writes them again.",
        table(("page", "contents"), rows),
    ]


def commands_page(commands: Iterable[Command]) -> Blocks:
    """Commands with their arguments and options, and exit codes."""
    blocks = [
        "# Commands",
        "Exit codes, the same for `bench run`, `bench rehearse` and `bench reduce`; other commands use those below 5:",
        table(("exit code", "meaning"), ((str(code), meaning) for code, meaning in MEANINGS.items())),
    ]
    for command in commands:
        blocks += [f"## bench {command.words}", command.help]
        if command.arguments:
            blocks.append(table(("argument or option", "default", "meaning"), map(_row, command.arguments)))
    return blocks


def _row(each: Argument) -> tuple[str, str, str]:
    """Return name, default and meaning of an argument as a table row."""
    without = "required" if each.is_required else f"`{each.without}`" if each.without else ""
    return f"`{each.words}`", without, each.help


PAGES: Mapping[str, Callable[..., Blocks]] = {
    INDEX: index_page,
    "sequence": sequence_page,
    "steps": steps_page,
    "methods": methods_page,
    "bench": bench_page,
    "drivers": drivers_page,
    COMMANDS_PAGE: commands_page,
    "mqtt": mqtt_page,
    "rules": rules_page,
    "errors": errors_page,
}


def page_text(name: str, commands: Iterable[Command]) -> str:
    """Return a page as Markdown; that on commands is of these. Raises InputError if there is no page of that name."""
    if name not in PAGES:
        raise InputError(f"there is no page '{name}'{did_you_mean(name, PAGES)}")
    page = partial(commands_page, commands) if name == COMMANDS_PAGE else PAGES[name]
    return "\n\n".join(page()) + "\n"


def write_pages(folder: Path, commands: Collection[Command]) -> list[Path]:
    """Write every page to `folder/PAGE.md`. Raises InputError if that fails."""
    paths = []
    for name in PAGES:
        paths.append(folder / f"{name}.md")
        with atomic_file(paths[-1]) as draft:
            draft.write_text(page_text(name, commands), "utf-8")
    return paths
