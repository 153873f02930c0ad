"""Whose instruments are in use: of all programs of this user on this computer, one at a time talks to an address.

A lock for each real address, in the folder of the control sockets; the kernel lets go of it when its owner dies. What
is in the file tells the next one who holds it. A simulated address needs no lock.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from bench.config.models import BenchFile
from bench.errors import InUseError, StoreError
from bench.runner.control import own_folder
from drivers.transport.address import Address

_WORDS_AT_MOST = 200


def real_addresses(bench: BenchFile) -> dict[str, Address]:
    """The addresses of a bench that are not simulated, by role."""
    return {role: entry.connection for role, entry in bench.devices.items() if not entry.connection.simulated}


@contextmanager
def holding(addresses: Iterable[Address], who: str) -> Iterator[None]:
    """Holds the addresses while inside, as `who`; InUseError names who has one of them already."""
    with ExitStack() as held:
        places = {_lock_of(address): address for address in addresses if not address.simulated}
        for lock, address in places.items():  # several instruments may share a line
            _hold(lock, address, f"{who}, process {os.getpid()}", held)
        yield


def _lock_of(address: Address) -> Path:
    """The file of an address: however it is spelled, a port is one."""
    place = f"{address.host}:{address.port}" if address.port else os.path.realpath(address.path)
    name = hashlib.sha256(place.encode()).hexdigest()[:20]
    try:
        return own_folder() / f"{name}.lock"
    except OSError as problem:
        raise StoreError(f"nobody can be told that {address} is in use ({problem})") from problem


def _hold(path: Path, address: Address, who: str, held: ExitStack) -> None:
    try:
        lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        held.callback(os.close, lock)
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.truncate(lock, 0)
        os.pwrite(lock, who.encode()[:_WORDS_AT_MOST], 0)
    except BlockingIOError:
        owner = os.pread(lock, _WORDS_AT_MOST, 0).decode(errors="replace")
        raise InUseError(
            f"{address} is in use by {owner or 'another program'}. Wait until it has ended, or end it: "
            "bench status tells what is under way"
        ) from None
    except OSError as problem:
        raise StoreError(f"nobody can be told that {address} is in use ({problem})") from problem
