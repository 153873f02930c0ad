"""Programs and computer in the manifest of a run."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

import pytest

from bench.runner import manifest


@pytest.mark.parametrize("program", manifest._PROGRAMS)
def test_the_version_of_a_program_is_that_of_its_distribution(program):
    assert manifest.version_of(program) == version(program)


def test_a_program_that_is_not_installed_has_no_version():
    with pytest.raises(PackageNotFoundError):
        manifest.version_of("no-such-program")


def test_a_version_in_the_description_is_not_taken(monkeypatch):
    class Found:
        def read_text(self, name: str) -> str:
            return f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.2.3\n\nVersion: 9\n"

    monkeypatch.setattr(manifest, "distribution", lambda _: Found())
    assert manifest.version_of("anything") == "1.2.3"


def test_the_system_is_named_with_its_kernel_and_starts_no_program(monkeypatch):
    monkeypatch.setattr("subprocess.check_output", None)
    assert manifest._system().startswith("Linux-")
