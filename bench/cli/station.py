"""serve, attempt: the station and the processes of its runs."""

from __future__ import annotations

from pathlib import Path

from bench.cli.commands import Command, argument


def attempt(folder: Path) -> int:
    """Make the attempt at a run that a station has prepared in a folder; the station calls this."""
    from bench.cli.main import main
    from bench.station.attempts import make

    return make(folder, main)


COMMANDS = (
    Command("attempt", attempt, (argument("FOLDER", "Folder of the attempt.", read=Path),)),
)  # fmt: skip
