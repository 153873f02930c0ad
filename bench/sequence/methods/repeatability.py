"""The repeatability of a tumble as a sequence sees it."""

from __future__ import annotations

from bench.sequence.methods import MethodDescription
from bench.sequence.methods.per_degree import BiasPerDegree


class RepeatabilitySettings(BiasPerDegree):
    """What is known of the unit beforehand."""


REPEATABILITY = MethodDescription(
    name="repeatability",
    title="Repeatability over remountings or power cycles",
    target="bench.analysis.repeatability:reduce",
    settings=RepeatabilitySettings,
    quantities={"K0/sd": "g", "K1/sd": "1", "misalignment/sd": "rad", "K0/closure": "g"},
    first_dwell=1,
    drawn_by="bench.report.repeated:repeated_shown",
)
