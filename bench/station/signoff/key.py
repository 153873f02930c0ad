"""Key that signs approved reports: the block `signature` of `station.yaml`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple, Self

from pydantic import Field, model_validator

from bench.config.devices import Text
from bench.errors import InputError
from bench.files import expect_private
from drivers.schema.bounded import UnfitFileError, read_bounded
from drivers.schema.fields import StrictModel
from drivers.schema.wording import telling

LIMIT_BYTES = 2**20
PKCS12 = (".p12", ".pfx")
CREDENTIALS = "CREDENTIALS_DIRECTORY"  # set by systemd for LoadCredential=


class SignatureEntry(StrictModel):
    """Key and certificate that sign approved reports (PAdES). Files are relative to this file."""

    key: Text = Field(description="private key in PEM, or key and certificate in PKCS#12 (.p12, .pfx), of mode 0600")
    certificate: str = Field("", description="certificate in PEM, those that issued it may follow; none with PKCS#12")
    passphrase_file: str = Field("", description="file of the passphrase of the key, of mode 0600")
    passphrase_credential: str = Field(
        "", pattern=r"^[A-Za-z0-9_.-]{0,64}$", description="name of the systemd credential that is the passphrase"
    )

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if bool(self.certificate) == self.key.lower().endswith(PKCS12):
            raise telling("a key in PEM needs a certificate; a file of PKCS#12 (.p12, .pfx) contains it")
        if self.passphrase_file and self.passphrase_credential:
            raise telling("the passphrase is either in a file or a credential of systemd")
        return self


class KeyFiles(NamedTuple):
    """Files of the key of a station, with absolute paths."""

    key: Path
    certificate: Path | None = None
    passphrase: Path | None = None
    credential: str = ""  # name of the credential of systemd that is the passphrase

    @property
    def is_pkcs12(self) -> bool:
        """True if the file of the key also has its certificate."""
        return self.key.suffix.lower() in PKCS12


def key_files(entry: SignatureEntry, beside: Path) -> KeyFiles:
    """Return the files of a key; they are read when something is signed."""
    certificate, passphrase = (
        (beside / name).absolute() if name else None for name in (entry.certificate, entry.passphrase_file)
    )
    return KeyFiles((beside / entry.key).absolute(), certificate, passphrase, entry.passphrase_credential)


def passphrase_of(files: KeyFiles) -> bytes | None:
    """Return the passphrase of a key, if it has one. Raises InputError."""
    if files.credential:
        return _credential(files.credential).rstrip(b"\r\n")
    return read_secret(files.passphrase).rstrip(b"\r\n") if files.passphrase is not None else None


def _credential(name: str) -> bytes:
    if (folder := os.environ.get(CREDENTIALS)) is None:
        raise InputError(
            f"signature: systemd has given this station no credentials; add LoadCredential={name}:FILE to its service"
        )
    try:
        return read_bounded(Path(folder) / name, LIMIT_BYTES)
    except UnfitFileError as problem:
        raise InputError(f"signature: the credential {name} cannot be read ({problem})") from None


def read_secret(path: Path) -> bytes:
    """Return the content of a file that only the user of the station may read. Raises InputError."""
    expect_private(path, "signature", is_own=True)
    try:
        return read_bounded(path, LIMIT_BYTES)
    except (OSError, UnfitFileError) as problem:
        raise InputError(f"signature: {path} cannot be read ({problem})") from None
