"""Fixture of the tests of archives."""

from __future__ import annotations

import pytest

from tests.support.archives import start_runtimes


@pytest.fixture(scope="session", autouse=True)
def _runtimes_of_libraries(tmp_path_factory) -> None:
    start_runtimes(tmp_path_factory.mktemp("first"))
