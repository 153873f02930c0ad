"""A short tumble over temperature: as of a unit of the other sign, and what comparisons between dwells are worth."""

from __future__ import annotations

import pytest

from tests.support.runs import run_short
from tests.truth.signs import differences


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    return run_short(tmp_path_factory.mktemp("runs"))


def test_a_unit_of_the_other_sign_differs_in_its_sign_alone(ran):
    assert list(differences(ran.path)) == []


def test_what_compares_dwells_has_the_heads_repeatability_in_its_budget(ran):
    found = {each.quantity: each for each in ran.results.units[0].findings}
    for quantity in ("K0", "K0/closure", "K0/model_residual"):
        assert "head: repeatability" in {line.source for line in found[quantity].budget}, quantity
