"""Turns leave out campaigns, and together leave out none."""

import pytest

from tests.support.turns import CAMPAIGNS, left_out, turn_of

FILES = {f"tests/truth/test_{letter}.py" for letter in "abcdefg"}


def test_every_campaign_has_exactly_one_turn():
    turns = [FILES - left_out(FILES, (number, 3)) for number in (1, 2, 3)]
    assert sorted(file for each in turns for file in each) == sorted(FILES)
    assert [len(each) for each in turns] == [3, 2, 2]


@pytest.mark.parametrize("text", ["", "1", "0/3", "4/3", "1/0", "-1/3", "a/b", "1/3/3"])
def test_a_turn_that_cannot_be_is_refused(text):
    with pytest.raises(pytest.UsageError, match="expected a turn such as 1/3"):
        turn_of(text)


def test_only_campaigns_take_turns(pytestconfig):
    assert all((pytestconfig.rootpath / folder).is_dir() for folder in CAMPAIGNS)
    assert not any(folder.startswith("tests/integration") for folder in CAMPAIGNS)
