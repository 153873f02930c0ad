"""The page that adds a step, followed literally: its files are built as a wheel, and a sequence runs with the step."""

from __future__ import annotations

import os

import pytest

from bench.store.reader import RunReader
from tests.support.how_to import FOLDER, commands, files_of, follow
from tests.support.runs import ROOT

pytestmark = pytest.mark.integration
PAGE = FOLDER / "add_a_step.md"


def test_a_newcomer_who_follows_the_page_has_a_step_that_runs(tmp_path):
    site = tmp_path / "site"
    env = {**os.environ, "PYTHONPATH": f"{site}:{ROOT}", "PYTHONDONTWRITEBYTECODE": "1"}
    written = files_of(PAGE)
    assert written.keys() == {"my_swing/pyproject.toml", "my_swing/my_swing.py", "swing.yaml"}
    for name, content in written.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(content, "utf-8")
    for words in commands(PAGE):
        done = follow(words, tmp_path, site, env)
        assert done.returncode in (0, 5), (words, done.stdout, done.stderr)  # 5: nothing is judged
    (run,) = (tmp_path / "runs").iterdir()
    with RunReader(run) as reader:
        (found,) = (event.data for event in reader.events("step_ended") if event.step == "steps/custom")
        (note,) = (event.data["note"] for event in reader.events("step_ended") if event.step == "steps/note")
    assert (found["as"], found["unit"]) == ("swing", "°C")
    assert 0 < found["value"] < 1
    assert note.startswith("the temperature of the unit swung by 0.")
    page = follow(("bench", "reference", "steps"), tmp_path, site, env).stdout
    assert "### custom: my_swing" in page
    assert "the temperature that is watched" in page
