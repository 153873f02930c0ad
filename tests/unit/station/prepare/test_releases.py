"""Released versions: what counts as the same files, and what is said of a change."""

import pytest

from bench.errors import InputError
from bench.station.prepare.releases import Releases
from bench.station.storage.database import Database

INPUTS = {
    "sequence.yaml": "gate: 5 s\n",
    "called/soak.yaml": "soak\n",
    "bench.yaml": "limits\n",
    "counter.dbc": "BO_\n",
}


@pytest.fixture
def releases(tmp_path):
    database = Database(tmp_path)
    yield Releases(database)
    database.close()


def changed(name, text):
    return INPUTS | {name: text}


def test_what_was_released_may_run_and_is_released_once(releases):
    with pytest.raises(InputError, match="sequence 'smoke' is not released"):
        releases.expect_released("smoke", "a", INPUTS)
    releases.release("smoke", "a", INPUTS, "erik", "first")
    releases.release("smoke", "a", INPUTS, "erik", "again")
    assert [(each.kind, each.name) for each in releases.all()] == [("bench", "a"), ("sequence", "smoke")]
    releases.expect_released("smoke", "a", INPUTS | {"released_a.json": "{}", "scenario.yaml": "x"})


@pytest.mark.parametrize(
    ("name", "part"), [("sequence.yaml", "sequence"), ("called/soak.yaml", "sequence"), ("counter.dbc", "bench")]
)
def test_a_change_of_any_file_is_shown_and_not_run(releases, name, part):
    releases.release("smoke", "a", INPUTS, "erik", "first")
    with pytest.raises(InputError, match=rf"the {part} .* differs from its released version: -.*; \+changed"):
        releases.expect_released("smoke", "a", changed(name, "changed\n"))
    lines = releases.difference("smoke", "a", changed(name, "changed\n"))
    assert "+changed" in lines
    assert lines[0].endswith(f"{name}, released")


def test_a_file_that_is_added_or_gone_is_a_change(releases):
    releases.release("smoke", "a", INPUTS, "erik", "first")
    for inputs in (INPUTS | {"other.dbc": "BO_\n"}, {name: INPUTS[name] for name in INPUTS if name != "counter.dbc"}):
        with pytest.raises(InputError, match="bench 'a' differs"):
            releases.expect_released("smoke", "a", inputs)


def test_only_the_newest_release_may_run(releases):
    releases.release("smoke", "a", INPUTS, "erik", "first")
    releases.release("smoke", "a", changed("sequence.yaml", "gate: 6 s\n"), "erik", "longer gate")
    with pytest.raises(InputError, match="differs"):
        releases.expect_released("smoke", "a", INPUTS)
    releases.expect_released("smoke", "a", changed("sequence.yaml", "gate: 6 s\n"))
