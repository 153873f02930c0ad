"""All commands by name, and the one that prints a page on them."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

from bench.cli import (
    archive,
    authoring,
    campaign,
    checking,
    control,
    devices,
    offline,
    people,
    queueing,
    rehearsing,
    running,
    service,
    station,
    stored,
    watching,
)
from bench.cli.commands import Command, argument, option
from bench.cli.streams import say


def reference(page: str, out: Path | None) -> None:
    """Print a page of the reference in Markdown: steps, keys of files, methods, drivers, commands, errors."""
    from bench.cli.reference import page_text, write_pages

    if out is None:
        sys.stdout.write(page_text(page, ALL))
        return
    say(*write_pages(out, ALL))


REFERENCE = Command("reference", reference, (
    argument("PAGE", "One of the pages listed by README.", default="README"),
    option("--out DIR", "Write all pages there instead of printing one.", read=Path),
))  # fmt: skip
ALL = (
    *checking.COMMANDS, *running.COMMANDS, *rehearsing.COMMANDS, *stored.COMMANDS, *devices.COMMANDS, *offline.COMMANDS,
    *archive.COMMANDS, *campaign.COMMANDS,
    *authoring.COMMANDS, REFERENCE, *control.COMMANDS, *station.COMMANDS,
    *queueing.COMMANDS, *watching.COMMANDS, *people.COMMANDS, *service.COMMANDS,
)  # fmt: skip
COMMANDS: Mapping[str, Command] = {command.words: command for command in ALL}
