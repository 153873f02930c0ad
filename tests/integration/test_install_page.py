"""The page on installing: its commands, followed with a station; the paths and files that it names."""

from __future__ import annotations

import os
import re

import pytest

from bench.station.install import PLACES
from bench.station.queue.items import Submission
from bench.station.queue.table import Queue
from bench.station.storage.database import Database
from tests.support.how_to import FOLDER, commands, follow

pytestmark = pytest.mark.integration
PAGE = FOLDER / "install.md"


def test_its_commands_lead_to_a_restored_station(tmp_path):
    database = Database(tmp_path / "station")
    Queue(database).submit(Submission(sequence="smoke", bench="demo"), "anna")
    database.close()
    said = {}
    for words in commands(PAGE):
        done = follow(words, tmp_path, tmp_path / "site", os.environ)
        assert done.returncode == 0, (words, done.stdout, done.stderr)
        said[words[1]] = done.stdout
    assert said.keys() == {"install-service", "backup", "restore"}
    assert "systemctl enable --now bench-station" in said["install-service"]
    assert "bench demo begins nothing until an engineer lets it go on" in said["restore"]
    assert "bench serve --folder elsewhere/station" in said["restore"]
    assert (tmp_path / "elsewhere/station/station.db").is_file()


def test_its_table_names_all_files_that_are_written():
    rows = " ".join(re.findall(r"^\| (`.*?) \|", PAGE.read_text("utf-8"), re.MULTILINE))
    for path in PLACES.values():
        assert path.rsplit("/", 1)[1] in rows or path.split("/")[2] in rows, path
