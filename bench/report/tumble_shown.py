"""What a report shows of a static tumble: its plots, and what its angles tell apart (methods.md 1.5)."""

from __future__ import annotations

from collections.abc import Iterator

from bench.analysis.finding import UnitResult
from bench.analysis.temperature_tumble import TumbleAngles
from bench.report.plots import Plot, unit_plots
from bench.report.tables import Sheet

BY_ITSELF = "found by itself"


def tumble_shown(unit: UnitResult, name: str) -> Iterator[Plot | Sheet]:
    """The plots of a unit and a table of the terms of the model equation; `name` begins the ids in the page."""
    yield from unit_plots(unit, name)
    if isinstance(unit.detail, TumbleAngles):
        yield _told_apart(unit.detail)


def _told_apart(found: TumbleAngles) -> Sheet:
    these = f"the {found.angles} angles"
    inside = {
        "K3": f"{these} cannot tell K3 from K1: K1 contains it",
        "Kip": f"{these} are blind to Kip: where one axis takes up the input the other is level",
        "asymmetry": f"{these} cannot tell the asymmetry of the converter from K2: K2 contains it",
    }
    rows = [("K0, K1, K2, misalignment", BY_ITSELF)]
    rows += [(term, BY_ITSELF if term in found.extra else words) for term, words in inside.items()]
    rows += [
        ("Kpp", "in one mounting never told from K0 and K2, whatever the angles: aᵢ² + aₚ² is 1"),
        ("Kio, Koo, the other misalignment", "not seen: they need a second mounting, turned about the input axis"),
    ]
    caption = f"The terms of the model equation, by {found.angles} angles of the input axis in one mounting."
    return Sheet("What the tumble tells apart", caption, (("Term", ""), ("In this run", "")), tuple(rows))
