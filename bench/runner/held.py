"""Address locks: of all programs of all users on this computer, only one at a time talks to an instrument.

A lock is an abstract Unix socket named after the address: it is in no folder, so that permissions, environments and
leftover files do not matter, and it disappears with its owner. A program that finds it taken connects to it and
receives the description of the owner; the kernel adds process and user. A simulated address needs no lock.
"""

from __future__ import annotations

import errno
import hashlib
import ipaddress
import os
import pwd
import selectors
import socket
import stat
import struct
import threading
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from enum import StrEnum
from typing import NamedTuple

from bench.config.models import BenchFile
from bench.errors import InUseError, StoreError
from bench.store.lockout import locked_out
from drivers.transport.address import Address

DISK_ANSWERS_S = 1.0
LOOKS = "followed "  # prefix of locks that mark supervision of a chamber; they do not lock the address itself
_WORDS_AT_MOST = 200
_OWNER_ANSWERS_S = 0.5
_pause = threading.Event().wait
_ATTEMPTS, _BETWEEN_ATTEMPTS_S = 3, 0.02  # the owner may end before it is asked, or may just have started
_LOOKS_AT_A_VISIT, _BETWEEN_LOOKS_S = 150, 0.1  # each reading ends within 10 s
_HERE = "this machine"


class Kind(StrEnum):
    """Kind of an owner: a run, a short reading of a chamber, a guardian that makes a bench safe, or another program."""

    RUN = "run"
    VISIT = "visit"
    RESCUE = "rescue"
    OTHER = ""


class Owner(NamedTuple):
    """Owner of the lock of an address: process and user (0 and -1 if it does not answer), description, and kind."""

    process: int
    user: int
    words: str
    kind: Kind = Kind.OTHER

    def __str__(self) -> str:
        if not self.process:
            return self.words
        named = f"{self.words or 'a program that does not answer'}, process {self.process}"
        return named + ("" if self.user == os.getuid() else f" of user {_user(self.user)}")


def real_addresses(bench: BenchFile) -> dict[str, Address]:
    """Return the addresses of a bench that are not simulated, by role."""
    return {role: entry.connection for role, entry in bench.devices.items() if not entry.connection.simulated}


def energising_addresses(bench: BenchFile) -> dict[str, Address]:
    """Return the real addresses of instruments that move or energise something, by role."""
    able = bench.with_capability("positioner", "rate_table", "thermal_chamber", "power_supply", "current_source")
    real = real_addresses(bench).items()
    return {role: at for role, at in real if role in able and not (at.is_person or at.is_recording)}


def why_locked_out(bench: BenchFile) -> str:
    """Return who works at the bench, and why; "" if it is not locked out."""
    addresses = {str(address) for address in real_addresses(bench).values()}
    return locked_out(addresses) if addresses else ""


def is_locked_out(bench: BenchFile) -> bool:
    """Return True if the bench is locked out; False if the disk does not answer, to avoid delaying a make-safe."""
    if not real_addresses(bench):
        return False
    found: list[str] = []
    looking = threading.Thread(target=lambda: found.append(why_locked_out(bench)), name="lockout", daemon=True)
    with suppress(RuntimeError):  # no memory for a thread
        looking.start()
        looking.join(DISK_ANSWERS_S)
    return any(found)


@contextmanager
def address_lock(addresses: Iterable[Address], who: str, kind: Kind = Kind.OTHER, purpose: str = "") -> Iterator[None]:
    """Hold the locks of the addresses in the block, as `who`; InUseError names the owner of one that is taken.

    Short readings of a chamber by others are waited for. `purpose` is LOOKS for locks that mark supervision.
    """
    # several instruments may share a line
    places = {purpose + mark: address for address in addresses for mark in marks(address)}
    with ExitStack() as held:
        locks = [held.enter_context(_lock(mark, places[mark])) for mark in sorted(places)]
        if locks:
            held.enter_context(_answering(locks, _printable(who).encode()[:_WORDS_AT_MOST] + f"\n{kind}".encode()))
        yield


def owners(addresses: Iterable[Address], purpose: str = "") -> set[Owner]:
    """Return the programs that hold any of the addresses, or with LOOKS supervise one."""
    places = {purpose + mark for address in addresses for mark in marks(address)}
    return {owner for mark in places if (owner := _owner(_name(mark))) is not None}


def is_followed(address: str) -> bool:
    """Return True if a program supervises the chamber at an address; a guardian ends its hold."""
    return bool(owners([Address.parse(address)], LOOKS))


def peer(connection: socket.socket) -> tuple[int, int]:
    """Return process and user at the other end of a Unix socket from the kernel; of a listener its creator."""
    size = struct.calcsize("3i")
    process, user, _ = struct.unpack("3i", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size))
    return process, user


def _lock(mark: str, address: Address) -> socket.socket:
    name, visited = _name(mark), 0
    owner, attempts = None, 0
    while attempts < _ATTEMPTS:
        lock = socket.socket(socket.AF_UNIX)
        try:
            lock.bind(name)
            lock.listen()
        except OSError as problem:
            lock.close()
            if problem.errno != errno.EADDRINUSE:
                raise StoreError(f"{address} cannot be locked ({problem})") from problem
        else:
            lock.setblocking(False)
            return lock
        owner = _owner(name)
        if owner is not None and owner.kind is Kind.VISIT and visited < _LOOKS_AT_A_VISIT:
            visited += 1
            _pause(_BETWEEN_LOOKS_S)
        elif owner is not None:
            break
        else:
            attempts += 1
            _pause(_BETWEEN_ATTEMPTS_S)
    raise InUseError(
        f"{address} is in use by {owner or 'another program'}. Wait until it has ended, or end it: "
        "'bench status' shows what is running"
    )


def _name(mark: str) -> str:
    return f"\0inertial-test-bench/{hashlib.sha256(mark.encode()).hexdigest()[:32]}"


def _owner(name: str) -> Owner | None:
    """Return the owner of the lock of this name, also if it does not answer; None if the lock is free."""
    words = ""
    with socket.socket(socket.AF_UNIX) as client:
        client.settimeout(_OWNER_ANSWERS_S)
        try:
            client.connect(name)
        except ConnectionRefusedError:
            return None
        except OSError:  # it hangs, and its backlog is full
            return Owner(0, -1, "another program, which does not answer")
        process, user = peer(client)
        try:
            words = client.recv(2 * _WORDS_AT_MOST).decode(errors="replace")
            if not words:
                return None  # the lock was released before it could answer
        except TimeoutError:
            pass
        except OSError:
            return None
    words, _, kind = words.partition("\n")
    return Owner(process, user, _printable(words), next((each for each in Kind if each == kind), Kind.OTHER))


def _printable(words: str) -> str:
    return "".join(letter if letter.isprintable() else "?" for letter in words)


def _user(number: int) -> str:
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return str(number)


@contextmanager
def _answering(locks: list[socket.socket], words: bytes) -> Iterator[None]:
    """Answer connections to the locks with the description, in a thread, during the block."""
    near, far = socket.socketpair()

    def answer() -> None:
        with selectors.DefaultSelector() as waiting:
            waiting.register(far, selectors.EVENT_READ)
            for lock in locks:
                waiting.register(lock, selectors.EVENT_READ, lock)
            while True:
                for key, _ in waiting.select():
                    if key.data is None:
                        return
                    _answer_one(key.data, words)

    thread = threading.Thread(target=answer, name="held", daemon=True)
    thread.start()
    try:
        yield
    finally:
        near.close()
        thread.join()
        far.close()


def _answer_one(lock: socket.socket, words: bytes) -> None:
    try:
        connection, _ = lock.accept()
    except BlockingIOError:  # the client has gone
        return
    except OSError:  # no descriptor is free; one may be released later
        _pause(_OWNER_ANSWERS_S)
        return
    with connection, suppress(OSError):
        connection.setblocking(False)
        connection.send(words)


def marks(address: Address) -> frozenset[str]:
    """Return the marks that an address shares with all other addresses of the same instrument.

    Empty for addresses that two programs cannot both drive: a person, a recording, a simulator. A name is resolved,
    which takes as long as the name service; an unknown name is a mark itself.
    """
    if address.simulated or address.is_person or address.is_recording:
        return frozenset()
    if address.port:
        return frozenset(f"port {address.port} of {host}" for host in _hosts(address.host))
    if address.path.startswith("/"):
        return frozenset({_file(address.path)})
    return frozenset({f"{address.scheme} {address.path}"})


def _hosts(name: str) -> set[str]:
    try:
        found = socket.getaddrinfo(name, None, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        return {name.lower()}
    return {_host(str(entry[4][0])) for entry in found}


def _host(numeric: str) -> str:
    """Return the canonical numeric address; that of this machine for all of its own."""
    ip: ipaddress.IPv4Address | ipaddress.IPv6Address = ipaddress.ip_address(numeric.partition("%")[0])
    if isinstance(ip, ipaddress.IPv6Address) and ip.ipv4_mapped is not None:
        ip = ip.ipv4_mapped
    return _HERE if ip.is_loopback or ip.is_unspecified or _is_own(ip) else str(ip)


def _is_own(ip: ipaddress.IPv4Address | ipaddress.IPv6Address) -> bool:
    """Return True if the address is of this machine; connecting a datagram socket sends nothing."""
    family = socket.AF_INET if ip.version == 4 else socket.AF_INET6
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.connect((str(ip), 9))
            return ipaddress.ip_address(probe.getsockname()[0]) == ip
    except OSError:  # no route
        return False


def _file(path: str) -> str:
    """Return the device or file of a path; the resolved path if there is none."""
    try:
        state = os.stat(path)
    except OSError:
        return f"path {os.path.realpath(path)}"
    if stat.S_ISCHR(state.st_mode):
        return f"device {os.major(state.st_rdev)}:{os.minor(state.st_rdev)}"
    return f"file {state.st_dev}:{state.st_ino}"
