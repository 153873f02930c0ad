"""The list of mends that are taken out on trial."""

from __future__ import annotations

import pytest

from campaigns.trials.planted import plants
from tests.support.runs import ROOT


@pytest.mark.parametrize("plant", plants(), ids=lambda plant: f"{plant.file}:{plant.line}"[:80])
def test_a_listed_mend_is_where_the_list_has_it(plant):
    assert plant.taken_out((ROOT / plant.file).read_text("utf-8"))
    assert (ROOT / plant.test.partition("::")[0]).is_file()
