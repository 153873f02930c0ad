"""Connection to a scheduler of dask.distributed, by TLS unless it is on this computer, or a cluster of processes here.

A scheduler and its workers execute what they are sent: whoever can connect is their user.
"""

from __future__ import annotations

import logging
import os
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.parse import urlsplit

from bench.campaign.local_cluster import Workers
from bench.client.address import LOOPBACK
from bench.errors import BenchError, InputError
from bench.files import expect_private
from bench.optional import imported

CONNECTS_WITHIN_S = 30.0
KILLS = 3  # of workers, after which the task that they had is taken for the cause
HERE = {  # configuration of a cluster of this computer
    "distributed.scheduler.allowed-failures": KILLS - 1,
    "distributed.scheduler.worker-saturation": 1.0,  # so that a killed worker had no task but the one it did
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.profile.enabled": False,  # this and the next take time from the tasks
    "distributed.admin.tick.interval": "2 s",
    "distributed.admin.tick.cycle": "10 s",
    "distributed.admin.system-monitor.interval": "10 s",
    "distributed.admin.system-monitor.gil.enabled": False,
    "distributed.scheduler.active-memory-manager.start": False,
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}


_OF_A_WORKER = ("tls_ca_file", "tls_worker_cert", "tls_worker_key", "tls_client_cert", "tls_client_key")


class SchedulerLost(BenchError):
    """The scheduler has ended, or the connection to it."""

    code = "scheduler"


@dataclass(frozen=True)
class TlsFiles:
    """PEM files of a certificate authority, and of the certificate and private key of this client.

    None leaves one to the configuration of dask (`distributed.comm.tls`, or `DASK_DISTRIBUTED__COMM__TLS__…`).
    """

    ca: Path | None = None
    cert: Path | None = None
    key: Path | None = None


def dask_distributed() -> ModuleType:
    """Return dask.distributed. Raises InputError if it is not installed."""
    return imported("distributed", "campaign", what="a campaign")


@contextmanager
def at_scheduler(address: str, files: TlsFiles) -> Iterator[Any]:
    """Yield a client of the scheduler at an address, tls://HOST:PORT or tcp://127.0.0.1:PORT.

    Raises InputError for another address or a missing TLS file, and SchedulerLost if nothing answers.
    """
    distributed = dask_distributed()
    is_secured = expect_secured(address)
    security = _security(files) if is_secured else None
    with distributed.utils.silence_logging_cmgr(logging.CRITICAL):
        try:
            client = distributed.Client(address, security=security, timeout=CONNECTS_WITHIN_S, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as problem:
            raise SchedulerLost(
                f"{address}: no connection to the scheduler ({' '.join(str(problem).split())[:300]}). Check that it "
                "runs, and that its certificate and that of this client are of the same authority"
            ) from None
        with _closing(client):
            yield client


@contextmanager
def _closing(client: Any) -> Iterator[None]:
    """Close a client at the end. One that tries to reach a lost scheduler again may fail at that, and is closed."""
    try:
        yield
    finally:
        with suppress(OSError, ValueError):  # ValueError: of a connection with TLS that ends while it begins
            client.close()


def expect_secured(address: str) -> bool:
    """Return True for an address with TLS, False for one of this computer. Raises InputError for any other."""
    try:
        found = urlsplit(address)
        host, port = found.hostname, found.port
    except ValueError as problem:
        raise InputError(f"--scheduler {address}: {problem}; expected tls://HOST:PORT") from None
    if found.scheme not in ("tls", "tcp") or not host or port is None:
        raise InputError(f"--scheduler {address}: expected tls://HOST:PORT, or tcp://127.0.0.1:PORT on this computer")
    if found.scheme == "tcp" and host not in LOOPBACK:
        raise InputError(
            f"--scheduler {address}: without TLS, everybody who reaches it can let its workers execute anything. "
            "Start it with certificates and give tls://HOST:PORT; plain tcp:// is for this computer alone"
        )
    return found.scheme == "tls"


def _security(files: TlsFiles) -> Any:
    """Security of a client by its files, and by the configuration of dask where none is given."""
    given = {
        "tls_ca_file": _readable("--tls-ca", files.ca),
        "tls_client_cert": _readable("--tls-cert", files.cert),
        "tls_client_key": _readable("--tls-key", files.key),
    }
    security = dask_distributed().Security(
        require_encryption=True, **{name: str(path) for name, path in given.items() if path is not None}
    )
    for option, name in zip(("--tls-ca", "--tls-cert", "--tls-key"), given, strict=True):
        if getattr(security, name) is None:
            raise InputError(f"a scheduler with TLS needs {option} FILE, or the same in the configuration of dask")
    key = str(security.tls_client_key)
    if "-----BEGIN" not in key:
        expect_private(Path(key), "--tls-key")
    return security


def _readable(option: str, path: Path | None) -> Path | None:
    if path is not None and not os.access(path, os.R_OK):
        raise InputError(f"{option} {path}: there is no such file, or it cannot be read")
    return path


@contextmanager
def here(workers: int) -> Iterator[Any]:
    """Yield a client of a cluster of so many processes of this computer, which end with the block.

    They talk by TLS with a key that only they know: other users of this computer cannot connect.
    """
    distributed = dask_distributed()
    imported("cryptography", "campaign", what="a campaign")
    import dask

    security = distributed.Security.temporary()
    keys = {name: getattr(security, name) for name in _OF_A_WORKER} | {"require_encryption": True}
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(HERE))
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="bench-campaign-", ignore_cleanup_errors=True))
        cluster = stack.enter_context(
            distributed.LocalCluster(
                n_workers=0, host="127.0.0.1", protocol="tls://", security=security, dashboard_address=None,
                scheduler_kwargs={"dashboard_address": "127.0.0.1:0"}, silence_logs=logging.CRITICAL,
            )
        )  # fmt: skip
        cluster.scheduler.add_plugin(_prompt(distributed))
        given = {"scheduler": cluster.scheduler_address, "security": keys, "folder": folder, "config": HERE}
        client = stack.enter_context(distributed.Client(cluster, set_as_default=False))
        stack.enter_context(Workers(workers, given).running())
        yield client


def _prompt(distributed: Any) -> Any:
    """Plug-in of a scheduler that sends tasks at once.

    Otherwise messages to a worker are 5 ms apart; a worker, which has one task at a time, then waits for the next.
    """

    class Prompt(distributed.SchedulerPlugin):  # type: ignore[misc]  # the library is optional
        def add_worker(self, scheduler: Any, worker: str, **_: Any) -> None:
            scheduler.stream_comms[worker].interval = 0.0

    return Prompt()
