"""Place of an archive: a folder, an S3 bucket or an Azure container, by URL.

Keys come from the environment: `AWS_ACCESS_KEY_ID`, `AWS_SECRET_ACCESS_KEY`, `AWS_REGION`, `AWS_ENDPOINT` and others
for S3, `AZURE_STORAGE_ACCOUNT_NAME`, `AZURE_STORAGE_ACCOUNT_KEY`, `AZURE_STORAGE_ENDPOINT` and others for Azure.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from bench.archive.libraries import obstore
from bench.client.address import LOOPBACK
from bench.clock import wall_utc
from bench.errors import InputError, StoreError

ABOUT, SCHEMA = "archive.json", "itb-archive/1"
CHUNK_BYTES = 8 * 2**20
AZURE = ("azure", "az", "abfs", "abfss", "adl")
_VARIABLES = {"s3": "AWS_", **dict.fromkeys(AZURE, "AZURE_")}
_NAMES = {  # as both libraries spell them; other variables of these prefixes are for other programs
    "AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN", "AWS_REGION", "AWS_DEFAULT_REGION",
    "AWS_ENDPOINT", "AWS_ENDPOINT_URL", "AWS_VIRTUAL_HOSTED_STYLE_REQUEST", "AZURE_STORAGE_ACCOUNT_NAME",
    "AZURE_STORAGE_ACCOUNT_KEY", "AZURE_STORAGE_SAS_KEY", "AZURE_STORAGE_ENDPOINT", "AZURE_STORAGE_CLIENT_ID",
    "AZURE_STORAGE_CLIENT_SECRET", "AZURE_STORAGE_TENANT_ID",
}  # fmt: skip
MOST_SHOWN = 300  # characters of an answer
NAMED = re.compile(r"<(BucketName|Key|Resource)>.*?</\1>|[^\s<>]*/[^\s<>]+")  # buckets, objects and URLs in an answer
ADVICE = (  # of what a store answers, in lower case: what to do
    ("no space left", "it is full: free space there; the push can be repeated"),
    ("quota", "it is full: free space there or raise its quota; the push can be repeated"),
    ("insufficientstorage", "it is full: free space there; the push can be repeated"),
    ("507 insufficient", "it is full: free space there; the push can be repeated"),
    ("timetooskewed", "the clocks of this computer and of the store differ: set the clock here"),
    ("date header", "the clocks of this computer and of the store differ: set the clock here"),
    ("nosuchbucket", "there is no such bucket: create it, or correct the name"),
    ("containernotfound", "there is no such container: create it, or correct the name"),
    ("read-only", "it cannot be written: mount it writable, or choose another folder"),
    ("permission denied", "the user who runs this may not write there"),
)


class Destination:
    """Opened store of an archive. All methods raise StoreError with what the store answered and what to do."""

    def __init__(self, url: str) -> None:
        self.url = _as_url(url)
        self.scheme = urlsplit(self.url).scheme
        self.options = _options(self.scheme)
        if self.scheme not in ("file", *_VARIABLES):
            raise InputError(f"{url}: an archive is a folder, s3://BUCKET/PREFIX or azure://CONTAINER/PREFIX")
        self._store = self._opened()

    def _opened(self) -> Any:
        stores = obstore().store
        try:
            if self.scheme == "file":
                return stores.LocalStore(urlsplit(self.url).path, mkdir=True)
            plain = self.options.get("allow_http") == "true"
            config = {name: value for name, value in self.options.items() if name != "allow_http"}
            return stores.from_url(
                self.url, config=config, client_options={"allow_http": plain, "timeout": timedelta(seconds=60)},
                retry_config={"max_retries": 4, "retry_timeout": timedelta(seconds=60)},
            )  # fmt: skip
        except (obstore().exceptions.BaseError, OSError) as problem:
            raise StoreError(self._in_words(problem)) from None

    def table_url(self, name: str) -> str:
        """Return the URL of a table as deltalake takes it."""
        found = urlsplit(self.url)
        if self.scheme == "file":
            return str(Path(found.path) / "tables" / name)
        scheme = "abfs" if self.scheme in AZURE else self.scheme  # deltalake commits wrongly by azure://
        return f"{scheme}://{found.netloc}{found.path.rstrip('/')}/tables/{name}"

    def write(self, name: str, data: bytes | Path) -> None:
        """Write an object, replacing one of that name; it is never half visible."""
        with self._errors(name):
            obstore().put(self._store, name, data)

    def create(self, name: str, data: bytes) -> bool:
        """Write an object if there is none of that name; return False if there is one."""
        with self._errors(name):
            try:
                obstore().put(self._store, name, data, mode="create")
            except obstore().exceptions.AlreadyExistsError:
                return False
        return True

    def read(self, name: str) -> bytes | None:
        """Return the content of an object, or None if there is none."""
        with self._errors(name):
            try:
                return bytes(obstore().get(self._store, name).bytes())
            except FileNotFoundError:
                return None

    def chunks(self, name: str) -> Iterator[bytes]:
        """Yield the content of a large object. Raises StoreError if there is none as well."""
        with self._errors(name):
            yield from self._stream(name)

    def _stream(self, name: str) -> Iterator[bytes]:
        return map(bytes, obstore().get(self._store, name).stream(min_chunk_size=CHUNK_BYTES))

    def digest(self, name: str) -> str | None:
        """Return the SHA-256 of an object as it is read back, with the prefix `sha256:`; None if there is none."""
        found = hashlib.sha256()
        with self._errors(name):
            try:
                for chunk in self._stream(name):
                    found.update(chunk)
            except FileNotFoundError:
                return None
        return f"sha256:{found.hexdigest()}"

    def names(self, prefix: str) -> Iterator[str]:
        """Yield the names of the objects below a prefix."""
        with self._errors(prefix):
            for some in obstore().list(self._store, prefix):
                yield from (each["path"] for each in some)

    def delete(self, name: str) -> None:
        """Delete an object."""
        with self._errors(name):
            obstore().delete(self._store, name)

    def prove(self) -> None:
        """Show that the store refuses to create what exists: without that, of two commits at once one would be lost.

        Raises StoreError if it does not.
        """
        name = f"probe/{uuid.uuid4().hex}"
        first, second = self.create(name, b"first"), self.create(name, b"second")
        found = self.read(name)
        self.delete(name)
        if not first or second or found != b"first":
            raise StoreError(
                f"{self.url}: the store overwrites an object that must not exist (If-None-Match is ignored): two "
                "benches would lose each other's results. Use a store with conditional writes"
            )

    def expect(self) -> None:
        """Raise InputError if there is no archive."""
        if (about := self.read(ABOUT)) is None:
            raise InputError(f"{self.url}: there is no archive; 'bench archive push RUN {self.url}' begins one")
        self._check(about)

    def begin(self) -> None:
        """Begin an archive if there is none."""
        if (about := self.read(ABOUT)) is not None:
            self._check(about)
            return
        content = {"schema": SCHEMA, "id": uuid.uuid4().hex, "begun": wall_utc().isoformat(timespec="seconds")}
        self.create(ABOUT, json.dumps(content).encode())

    def _check(self, about: bytes) -> None:
        try:
            schema = json.loads(about)["schema"]
        except (ValueError, TypeError, KeyError):
            schema = "unreadable"
        if schema != SCHEMA:
            raise InputError(f"{self.url}/{ABOUT}: {schema}; this version reads and writes {SCHEMA}")

    @contextmanager
    def _errors(self, name: str) -> Iterator[None]:
        try:
            yield
        except (obstore().exceptions.BaseError, OSError) as problem:
            raise StoreError(self._in_words(problem, name)) from None

    def _in_words(self, problem: Exception, name: str = "") -> str:
        return in_words(f"{self.url.rstrip('/')}/{name}" if name else self.url, problem)


def in_words(where: str, problem: Exception) -> str:
    """Return a message for an error of a store: the place, what to do, and what the store answered."""
    whole = " ".join(str(problem).partition("Debug source")[0].split())
    found = re.search("<Code>(.*?)</Code>.*?<Message>(.*?)(RequestId|</Message>)", whole)
    answer = f"{found[1]}: {found[2]}" if found else whole[:MOST_SHOWN]
    lower = NAMED.sub(" ", whole).lower()
    known = next((advice for sign, advice in ADVICE if sign in lower), "")
    exceptions = obstore().exceptions
    if not known and isinstance(problem, exceptions.PermissionDeniedError | exceptions.UnauthenticatedError):
        known = "the store refuses the key: check the key and its rights in the environment"
    if not known and any(sign in lower for sign in ("connect", "dns", "timed out", "error sending request")):
        known = "the store does not answer: check the network and the address; the push can be repeated"
    return f"{where}: {known}{'. The store: ' if known else ''}{answer}"


def _as_url(given: str) -> str:
    if "://" in given:
        return given.rstrip("/") if urlsplit(given).path.strip("/") or not given.startswith("file") else given
    return Path(given).expanduser().absolute().as_uri()


def _options(scheme: str) -> Mapping[str, str]:
    """Options of both libraries from the environment; without TLS only on this computer, or if it is asked for."""
    prefix = _VARIABLES.get(scheme)
    if prefix is None:
        return {}
    found = {name.lower(): value for name, value in os.environ.items() if name in _NAMES and name.startswith(prefix)}
    if "aws_endpoint_url" in found:
        found["aws_endpoint"] = found.pop("aws_endpoint_url")
    endpoint = urlsplit(found.get("aws_endpoint") or found.get("azure_storage_endpoint") or "")
    asked = os.environ.get(f"{prefix}ALLOW_HTTP", "").lower() == "true"
    if endpoint.scheme == "http":
        if endpoint.hostname not in LOOPBACK and not asked:
            raise InputError(
                f"{endpoint.geturl()}: is without TLS; use https, or set {prefix}ALLOW_HTTP=true on a network that "
                "nobody else can read"
            )
        found["allow_http"] = "true"
    return found
