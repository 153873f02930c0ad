"""Libraries of the extra `archive`, imported when they are needed."""

from __future__ import annotations

from types import ModuleType

from bench.optional import imported


def _of_extra(module: str) -> ModuleType:
    return imported(module, "archive", what="an archive")


def arrow() -> ModuleType:
    """Return pyarrow. Raises InputError if it is not installed, as all functions here."""
    return _of_extra("pyarrow")


def parquet() -> ModuleType:
    """Return pyarrow.parquet."""
    return _of_extra("pyarrow.parquet")


def obstore() -> ModuleType:
    """Return obstore."""
    return _of_extra("obstore")


def deltalake(module: str = "deltalake") -> ModuleType:
    """Return deltalake, or one of its modules."""
    return _of_extra(module)


def duckdb() -> ModuleType:
    """Return duckdb."""
    return _of_extra("duckdb")


def sqlalchemy() -> ModuleType:
    """Return sqlalchemy."""
    return _of_extra("sqlalchemy")
