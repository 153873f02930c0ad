"""A short tumble over temperature: as of a unit of the other sign, and what comparisons between dwells are worth."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bench.metrology.unlike_nominal import OTHER_SIGN, OTHER_SIZE
from bench.reduce.evaluate import evaluate
from bench.reduce.journal import JournalRecords
from bench.reduce.stored_run import open_run
from campaigns.truth.signs import differences, negated


def test_a_unit_of_the_other_sign_differs_in_its_sign_alone(tumble_run):
    assert list(differences(tumble_run.path)) == []


def test_what_compares_dwells_has_the_heads_repeatability_in_its_budget(tumble_run):
    found = {each.quantity: each for each in tumble_run.results.units[0].findings}
    for quantity in ("K0", "K0/closure", "K0/model_residual"):
        assert "head: repeatability" in {line.source for line in found[quantity].budget}, quantity


@pytest.mark.parametrize(
    ("factor", "flag"),
    [(1.0, OTHER_SIGN), (-1.0, None), (-9.80665, OTHER_SIZE), (-1e-3, OTHER_SIZE), (-1.6, None)],
    ids=["stated positive", "stated as it is", "per m/s² for g", "a thousandth", "by 60 %"],
)
def test_a_scale_factor_that_is_not_the_stated_one_is_flagged(tumble_run, factor, flag):
    with open_run(tumble_run.path) as stored:

        def inverted(label):
            was = stored.data(label)
            units = tuple(replace(unit, nominal_per_g=factor * unit.nominal_per_g) for unit in was.units)
            return replace(negated(was), units=units)

        found = evaluate(stored.sequence, inverted, "completed", JournalRecords())
    of_scale = [each for each in found.units[0].findings if each.quantity == "K1"]
    assert of_scale
    for each in of_scale:
        assert each.value < 0
        assert {OTHER_SIGN, OTHER_SIZE} & set(each.flags) == ({flag} if flag else set())
