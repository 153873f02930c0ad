"""A PostgreSQL of this test alone, on a socket in its folder."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_FOLDERS = sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)


def postgres_program(name: str) -> str | None:
    """Path of a program of PostgreSQL, or None; Debian keeps them out of the PATH."""
    return shutil.which(name, path=os.pathsep.join([*map(str, _FOLDERS), os.environ["PATH"]]))


@contextmanager
def postgres(folder: Path) -> Iterator[str]:
    """URL of an empty database; the server never runs as root, which it refuses."""
    data, socket = folder / "data", folder / "s"
    socket.mkdir(parents=True)
    if os.geteuid() == 0:
        for each in (folder, socket):
            shutil.chown(each, "nobody")
        for parent in folder.parents:
            if parent.stat().st_uid == 0 and parent.is_relative_to("/tmp"):
                parent.chmod(parent.stat().st_mode | 0o011)
    _run("initdb", "-D", data, "-U", "lims", "--auth=trust", "--no-sync")
    _run(
        "pg_ctl", "-D", data, "-w", "-l", folder / "log", "start",
        "-o", f"-k {socket} -c listen_addresses='' -c fsync=off",
    )  # fmt: skip
    try:
        yield f"postgresql+psycopg://lims@/postgres?host={socket}"
    finally:
        _run("pg_ctl", "-D", data, "-m", "immediate", "stop")


def _run(name: str, *words: object) -> None:
    program = postgres_program(name)
    assert program is not None
    user = "nobody" if os.geteuid() == 0 else None
    subprocess.run([program, *map(str, words)], check=True, user=user, cwd="/", stdout=subprocess.DEVNULL, timeout=120)
