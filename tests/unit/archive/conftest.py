"""Fixture of the tests of archives."""

from __future__ import annotations

import pytest

from bench.archive.destination import Destination
from bench.archive.query import Archive


@pytest.fixture(scope="session", autouse=True)
def _runtimes_of_libraries(tmp_path_factory) -> None:
    """Starts the threads and files that the libraries keep for the whole process, so that no test is blamed for them."""
    destination = Destination(str(tmp_path_factory.mktemp("first")))
    destination.begin()
    destination.digest("archive.json")
    Archive(destination).query("SELECT count(*) FROM findings")
