"""install-service, backup, restore: a station as a service of its computer, and copies of its records."""

from __future__ import annotations

from pathlib import Path

from bench.cli.commands import Command, argument, flag, option
from bench.cli.streams import say

_LEFT = {"unchanged": "unchanged", "kept": "kept", "differs": "kept, though it differs; --replace writes ours"}


def install_service(settings: Path | None, program: Path | None, root: Path, *, replace: bool, dry_run: bool) -> None:
    """Write the units of systemd, the user, and the rules for polkit and udev that make a station a service.

    A file that differs from ours is kept and the difference shown, unless --replace is given. The command starts
    nothing: it prints what is to be done by hand.
    """
    from bench.station.install import SETTINGS, by_hand, own_program, service_files

    ours = program or own_program()
    for file in service_files(root, ours, settings or SETTINGS):
        writes = file.state == "new" or (file.state == "differs" and replace)
        if writes and not dry_run:
            file.write()
        done = {"new": "written", "differs": "replaced"}[file.state] if writes else _LEFT[file.state]
        say(f"{file.path}: {'would be ' if writes and dry_run else ''}{done}")
        say(*(f"    {line}" for line in file.difference()))
    say("\nBy hand, as root:", *by_hand(ours))


def backup(folder: Path, out: Path | None, settings: Path | None, runs: Path | None) -> None:
    """Write a backup of a station, also while it runs: queue, users, audit, attempts, and settings if named.

    Runs are part of it with --runs, if they have ended.
    """
    from bench.errors import InputError
    from bench.station.storage.backup import back_up

    if out is None:
        raise InputError("name the archive: --out FILE.tar.xz")
    back_up(folder, out, say, settings=settings, runs=runs)
    say(f"{out}: {out.stat().st_size} bytes, readable by this user only; it holds the hashes of passwords")


def restore(archive: Path, folder: Path) -> None:
    """Restore a backup into a new or empty folder. Its benches begin nothing until a person lets them go on."""
    from bench.station.storage.backup import STATION
    from bench.station.storage.backup import restore as restored

    found = restored(archive, folder)
    for bench in found.benches:
        say(f"bench {bench} begins nothing until an engineer lets it go on: items of the backup may have run since")
    words = ["bench serve", *([str(found.settings)] if found.settings else []), f"--folder {folder / STATION}"]
    runs = [f"--runs {found.runs}"] if found.runs else []
    say(f"{folder}: restored. Start it there: {' '.join([*words, *runs])}")


COMMANDS = (
    Command("install-service", install_service, (
        option("--settings FILE", "Settings; default: /etc/inertial-test-bench/station.yaml.", read=Path),
        option("--program FILE", "Program of the service; default: the one that runs this.", read=Path),
        option("--root DIR", "Folder that the files are written below.", read=Path, default=Path("/")),
        flag("--replace", "Replace files that differ from ours."),
        flag("--dry-run", "Write nothing; show what would be done."),
    )),
    Command("backup", backup, (
        argument("FOLDER", "Folder of the station's own records.", read=Path),
        option("--out FILE", "Archive to write, .tar.xz or .tar.gz.", read=Path),
        option("--settings FILE", "Settings of the station, to be included with the files that they name.", read=Path),
        option("--runs DIR", "Directory of runs to be included.", read=Path),
    )),
    Command("restore", restore, (
        argument("ARCHIVE", "A backup.", read=Path),
        argument("FOLDER", "New or empty folder.", read=Path),
    )),
)  # fmt: skip
