"""Report of a static tumble: its plots, and the terms that its angles separate (equations 1.5)."""

from __future__ import annotations

from collections.abc import Iterator

from bench.figures.languages import tr
from bench.figures.plots import Plot, unit_plots
from bench.figures.sheet import Sheet
from bench.figures.words import quantity_in_words
from bench.methods.tumble.reduction.run import TumbleAngles
from bench.methods.tumble.shown_loops import loops_shown
from bench.metrology.results.finding import UnitResult

OF_SECOND_MOUNT = ("misalignment_y", "Kio")


def tumble_shown(unit: UnitResult, name: str) -> Iterator[Plot | Sheet]:
    """Plots of the unit and a table of the terms of the model equation; `name` is the prefix of the ids in the page."""
    yield from unit_plots(unit, name)
    yield from loops_shown(unit, name)
    if isinstance(unit.detail, TumbleAngles):
        yield _separated_terms(unit.detail)


def _separated_terms(found: TumbleAngles) -> Sheet:
    by_itself = tr("found by itself")
    inside = {
        "K3": tr("these angles cannot separate K3 from K1: K1 contains it"),
        "Kip": tr("these angles cannot show Kip: where one axis senses the input, the other is level"),
        "asymmetry": tr("these angles cannot separate the asymmetry from K2: K2 contains it"),
    }
    rows = [(tr("K0, K1, K2, misalignment"), by_itself)]
    rows += [(tr(term), by_itself if term in found.extra else words) for term, words in inside.items()]
    if set(OF_SECOND_MOUNT).isdisjoint(found.extra):
        caption = tr(
            "The terms of the model equation, by {count} angles of the input axis in one mounting.", count=found.angles
        )
        rows += [
            ("Kpp", tr("in one mounting not separable from K0 and K2 at any angles: aᵢ² + aₚ² is 1")),
            (
                tr("Kio, Koo, the other misalignment"),
                tr("not observable: they need a second mounting, rotated about the input axis"),
            ),
        ]
    else:
        caption = tr(
            "The terms of the model equation, by {count} angles of the input axis, clocked by 90° about it too.",
            count=found.angles,
        )
        rows += [(quantity_in_words(term), by_itself) for term in OF_SECOND_MOUNT if term in found.extra]
        rows.append(("Kpp, Koo", tr("not separable from K0 and K2 at any angles: the squares of both axes add to 1")))
    return Sheet(tr("What the tumble can separate"), caption, ((tr("Term"), ""), (tr("In this run"), "")), tuple(rows))
