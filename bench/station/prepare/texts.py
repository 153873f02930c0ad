"""Texts of sequences: read with their versions, saved as new versions. None is ever lost by saving."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from threading import Lock

from pydantic import BaseModel, ConfigDict, Field

from bench.config.document import SIZE_LIMIT_BYTES
from bench.errors import InputError, StaleError, StoreError
from bench.files import write_atomically
from bench.station.names import WORD
from bench.station.prepare.versions import STATION, GitFolder, Version
from bench.station.settings import Settings
from drivers.schema.bounded import UnfitFileError, read_bounded

FOUND = "Changed without the station"
_SUFFIX = ".yaml"


class SequenceText(BaseModel):
    """Text of a sequence."""

    model_config = ConfigDict(frozen=True)

    name: str
    text: str
    digest: str = Field(description="SHA-256 of the text; a change names the one that it is made from")
    own: bool = Field(description="of the laboratory, and so it can be changed; otherwise shipped")
    file: str = Field("", description="path of the file")


class ChangedError(StaleError):
    """Text that has been changed since it was read. `now` is the present one."""

    def __init__(self, now: SequenceText) -> None:
        self.now = now
        super().__init__(
            "the sequence has been changed since you began; nothing was saved. "
            "Compare your text with it, then save again"
        )


class Texts:
    """Texts of the sequences of a station; those of its own folder have versions. Methods wait for the disk."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        folder = settings.own_sequences
        self.git = GitFolder(folder, is_own=folder.is_relative_to(settings.folder))
        self._saving = Lock()

    @property
    def folder(self) -> Path:
        """Folder of the sequences of the laboratory."""
        return self.git.folder

    def text(self, name: str) -> SequenceText:
        """Return the text of a sequence. Raises InputError."""
        path = self._settings.sequence_file(name)
        return _text(name, path, own=path.parent == self.folder)

    def versions(self, name: str) -> list[Version]:
        """Return the versions of a sequence, newest first. Raises InputError, and StoreError without git."""
        return self.git.versions(file_name(name))

    def version(self, name: str, version: str) -> str:
        """Return the text of a version of a sequence. Raises InputError."""
        return self.git.text(file_name(name), version)

    def save(self, name: str, text: str, base: str, by: str, message: str) -> SequenceText:
        """Save a text as a new version of a sequence in the folder of the laboratory, and return it.

        `base` is the digest of the text that it was made from, "" for a new sequence. Raises ChangedError if the
        present text is another one, InputError for a name or a text that cannot be a sequence, and StoreError.
        """
        path, text = self.folder / file_name(name), as_file(text)
        if not message.strip():
            raise InputError("say in a few words what has changed, and why")
        with self._saving:
            before = self._present(name, path)
            if before is not None and not base:
                raise InputError(f"there is a sequence '{name}' already; choose another name")
            if (before.digest if before is not None else "") != base:
                raise ChangedError(before or SequenceText(name=name, text="", digest="", own=True))
            if before is not None and before.text == text:
                raise InputError("nothing has changed")
            self.git.begin()
            if before is not None and not self.git.is_kept(path.name):
                self.git.keep(path.name, STATION, FOUND)
            present = path.read_bytes() if before is not None else None
            write_atomically(path, text.encode())
            try:
                self.git.keep(path.name, by, message)
            except StoreError:
                _put_back(path, present)
                raise
            return _text(name, path, own=True)

    def _present(self, name: str, path: Path) -> SequenceText | None:
        if path.is_symlink() or (path.exists() and not path.is_file()):
            raise InputError(f"{path}: is not a file of this folder, and so it is not changed here")
        return _text(name, path, own=True) if path.is_file() else None


def as_file(text: str) -> str:
    """Return a text as it is in a file: lines that end alike, the last one as well. Raises InputError if it is long."""
    found = re.sub(r"\r\n?", "\n", text).rstrip("\n") + "\n"
    try:
        size = len(found.encode())
    except UnicodeEncodeError:
        raise InputError("the text contains half a character, which no file can hold") from None
    if size > SIZE_LIMIT_BYTES:
        raise InputError(f"a sequence has at most {SIZE_LIMIT_BYTES // 1024} KiB, this text has {size // 1024 + 1} KiB")
    return found


def file_name(name: str) -> str:
    """Return the name of the file of a sequence. Raises InputError for what is no name."""
    if not re.fullmatch(WORD, name):
        raise InputError(
            f"'{name[:64]}' is no name of a sequence: letters, digits and _ . + -, at most 64, a letter or digit first"
        )
    return name + _SUFFIX


def _text(name: str, path: Path, *, own: bool) -> SequenceText:
    try:
        data = read_bounded(path, SIZE_LIMIT_BYTES)
    except UnfitFileError as problem:
        raise InputError(f"{path}: {problem}") from None
    digest = hashlib.sha256(data).hexdigest()
    return SequenceText(name=name, text=data.decode("utf-8", "replace"), digest=digest, own=own, file=str(path))


def _put_back(path: Path, present: bytes | None) -> None:
    if present is None:
        path.unlink(missing_ok=True)
    else:
        write_atomically(path, present)
