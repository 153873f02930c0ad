"""Files of a run: those that its record lists, by name, and nothing else."""

import json
import os

import pytest

from bench.errors import InputError
from bench.station.runs.record_files import files_of, opened
from bench.store.runs import summary
from tests.support.stored_results import instant, stored


@pytest.fixture
def run(tmp_path):
    folder = stored(
        tmp_path / "runs", instant(2020),
        hashes={"results.json": "sha256:r", "../secret": "sha256:x", "link": "sha256:l", "pipe": "sha256:p"},
    )  # fmt: skip
    (tmp_path / "runs/secret").write_text("secret")
    (folder / "notes.txt").write_text("not of the record")
    (folder / "report.html").write_text("<script>alert(1)</script>")
    (folder / "report_revisions.json").write_text(json.dumps({"files": {"report.html": "sha256:h"}}))
    (folder / "link").symlink_to(tmp_path / "runs/secret")
    os.mkfifo(folder / "pipe")
    return summary(folder)


def test_the_record_lists_its_files(run):
    assert {each.name for each in files_of(run)} == {"manifest.json", "results.json", "report.html"}


@pytest.mark.parametrize(
    "name", ["notes.txt", "../secret", "..", ".", "", "link", "pipe", "results.json/", "/etc/passwd", "results.json\0"]
)
def test_nothing_else_is_opened(run, name):
    with pytest.raises(InputError, match="lists no file"):
        opened(run, name)


def test_a_file_that_becomes_a_link_meanwhile_is_not_followed(run, monkeypatch):
    listed = files_of(run)
    monkeypatch.setattr("bench.station.runs.record_files.files_of", lambda _: listed)
    path = run.path / "results.json"
    path.unlink()
    path.symlink_to(run.path.parent / "secret")
    with pytest.raises(InputError, match="cannot be read"):
        opened(run, "results.json")


def test_a_report_is_active_content(run):
    active = {each.name: each.is_active for each in files_of(run)}
    assert active == {"manifest.json": False, "results.json": False, "report.html": True}
    found, file = opened(run, "report.html")
    with file:
        assert len(file.read()) == found.size
