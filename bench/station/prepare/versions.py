"""Versions of the files of a git folder: who saved what, when and why.

Git is called as a program, without settings of its user and without programs that a folder names, such as hooks.
"""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from bench.errors import InputError, StoreError
from bench.files import make_folder

LIMIT_S = 20.0
MOST = 200
ID = re.compile(r"[0-9a-f]{40}(?:[0-9a-f]{24})?")
STATION = "station"  # author of changes that were made without the station
_SETTINGS = (
    "core.hooksPath=/dev/null", "core.fsmonitor=false", "core.attributesFile=/dev/null", "core.autocrlf=false",
    "core.quotePath=false", "core.fsync=all", "commit.gpgSign=false", "gc.auto=0", "log.showSignature=false",
    "init.defaultBranch=main", "maintenance.auto=false",
)  # fmt: skip
_OPTIONS = [word for setting in _SETTINGS for word in ("-c", setting)]
_FORM = "--format=%H%x00%an%x00%aI%x00%s"


class Version(BaseModel):
    """Version of a file."""

    model_config = ConfigDict(frozen=True)

    id: str = Field(description="hash of the commit")
    by: str
    at: datetime
    message: str


class GitFolder:
    """Folder of files in a git work tree. Its work tree may begin above the folder, unless the folder `is_own`.

    All methods wait for git, at most LIMIT_S, and raise StoreError with what to do if it cannot be used.
    """

    def __init__(self, folder: Path, *, is_own: bool) -> None:
        self.folder = folder
        self._env = {
            "PATH": os.environ.get("PATH", os.defpath), "LC_ALL": "C.UTF-8", "GIT_CONFIG_NOSYSTEM": "1",
            "GIT_CONFIG_GLOBAL": os.devnull, "GIT_TERMINAL_PROMPT": "0", "GIT_LITERAL_PATHSPECS": "1",
            "GIT_OPTIONAL_LOCKS": "0",
        }  # fmt: skip
        if is_own:
            self._env["GIT_CEILING_DIRECTORIES"] = str(folder.parent)

    def is_there(self) -> bool:
        """Return True if the folder is in a work tree."""
        return self.folder.is_dir() and self._git("rev-parse", "--is-inside-work-tree", may_fail=True) == "true\n"

    def begin(self) -> None:
        """Make the folder a work tree of its own if it is in none."""
        try:
            make_folder(self.folder)
        except OSError as problem:
            raise StoreError(f"{self.folder}: cannot be created ({problem})") from problem
        if not self.is_there():
            self._git("init", "--quiet")

    def versions(self, name: str) -> list[Version]:
        """Return the versions of a file, newest first; [] for a file or folder without any."""
        if not self.is_there():
            return []
        found = self._git("log", f"--max-count={MOST}", _FORM, "--", name, may_fail=True)  # fails without a commit
        entries = [line.split("\0") for line in found.split("\n") if line]
        return [Version(id=id_, by=by, at=datetime.fromisoformat(at), message=why) for id_, by, at, why in entries]

    def text(self, name: str, version: str) -> str:
        """Return the text of a version of a file. Raises InputError if there is none."""
        if not ID.fullmatch(version) or not self.is_there():
            raise InputError(f"there is no version '{version[:64]}' of {name}")
        size = self._git("cat-file", "-s", f"{version}:./{name}", may_fail=True).strip()
        if not size.isdigit() or int(size) > 2**20:
            raise InputError(f"there is no version '{version[:12]}' of {name}")
        return self._git("cat-file", "blob", f"{version}:./{name}")

    def is_kept(self, name: str) -> bool:
        """Return True if the newest version of a file is the file as it is."""
        return self._git("status", "--porcelain", "--", name) == "" and bool(self._git("ls-files", "--", name))

    def keep(self, name: str, by: str, message: str) -> None:
        """Make a version of a file as it is; other files, also those that somebody has staged, stay as they are."""
        self._git("add", "--", name)
        who = {"NAME": by, "EMAIL": f"{re.sub(r'[^a-z0-9]+', '.', by.lower()).strip('.') or 'somebody'}@station"}
        env = {f"GIT_{role}_{part}": value for role in ("AUTHOR", "COMMITTER") for part, value in who.items()}
        words = ("commit", "--quiet", "--no-verify", "--cleanup=whitespace", "--file=-", "--only", "--", name)
        self._git(*words, text=message, env=env)

    def _git(self, *words: str, text: str = "", env: Mapping[str, str] | None = None, may_fail: bool = False) -> str:
        try:
            done = subprocess.run(  # noqa: S603  our own words; names have no path and no option
                ["git", "-C", str(self.folder), *_OPTIONS, *words],  # noqa: S607  wherever it is installed
                input=text.encode(), capture_output=True, env={**self._env, **(env or {})}, timeout=LIMIT_S,
                check=False,
            )  # fmt: skip
        except FileNotFoundError:
            raise StoreError(
                "versions of sequences need git, which is not installed at the station: apt install git"
            ) from None
        except (OSError, subprocess.TimeoutExpired) as problem:
            raise StoreError(f"{self.folder}: git cannot be used ({problem})") from problem
        if done.returncode != 0 and not may_fail:
            why = done.stderr.decode(errors="replace").strip() or done.stdout.decode(errors="replace").strip()
            raise StoreError(f"{self.folder}: git {words[0]} has failed ({why[:500]})")
        return done.stdout.decode(errors="replace") if done.returncode == 0 else ""
