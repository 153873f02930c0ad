"""Turns leave out slow tests, and together leave out none."""

import pytest

from tests.support.turns import ALWAYS, CAMPAIGNS, left_out, turn_of

FILES = {f"tests/truth/test_{letter}.py" for letter in "abcdefg"}


def test_every_file_has_exactly_one_turn():
    others = {f"tests/integration/test_{letter}.py" for letter in "abcde"}
    turns = [(FILES | others) - left_out(FILES | others, (number, 3)) for number in (1, 2, 3)]
    assert sorted(file for each in turns for file in each) == sorted(FILES | others)
    assert [(len(each & FILES), len(each & others)) for each in turns] == [(3, 2), (2, 2), (2, 1)]


def test_some_files_are_always_run(pytestconfig):
    assert not any(left_out(set(ALWAYS), (number, 3)) for number in (1, 2, 3))
    assert all((pytestconfig.rootpath / file).is_file() for file in ALWAYS)


@pytest.mark.parametrize("text", ["", "1", "0/3", "4/3", "1/0", "-1/3", "a/b", "1/3/3"])
def test_a_turn_that_cannot_be_is_refused(text):
    with pytest.raises(pytest.UsageError, match="expected a turn such as 1/3"):
        turn_of(text)


def test_campaigns_are_folders(pytestconfig):
    assert all((pytestconfig.rootpath / folder).is_dir() for folder in CAMPAIGNS)
