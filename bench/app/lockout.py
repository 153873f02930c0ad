"""Locking benches out while a person works at them, and lifting the lockout."""

from __future__ import annotations

from collections.abc import Iterator

from bench.app.request import load_bench_named
from bench.clock import wall_utc
from bench.errors import InputError
from bench.runner.held import real_addresses
from bench.store.lockout import lift, lock_out, lockouts
from bench.store.machine_state import printable


def set_lockout(name: str, by: str, reason: str) -> None:
    """Record that a person works at the bench of a name or path. Raises InputError, StoreError."""
    loaded = load_bench_named(name)
    connections = {role: str(address) for role, address in real_addresses(loaded.bench).items()}
    if not connections:
        raise InputError(f"{loaded.document.path}: every instrument is simulated; there is nothing to lock out")
    lock_out(loaded.document.path, wall_utc(), by, reason, connections)


def lift_lockout(name: str, by: str, reason: str) -> None:
    """Lift the lockout of the bench of a name or path. Raises InputError, StoreError."""
    lift(load_bench_named(name).document.path, wall_utc(), by, reason)


def listed() -> Iterator[str]:
    """Yield a line for each locked-out bench."""
    yield from (printable(f"{each.bench}: {each.in_words}") for each in lockouts())
