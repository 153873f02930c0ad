"""An indexing head on an Aerotech Ensemble."""

from __future__ import annotations

from drivers.description import Nothing, Setup
from drivers.dialects.aerotech_ensemble.axis import EnsembleAxis
from drivers.dialects.aerotech_ensemble.description import EnsembleOptions
from drivers.kinds.head.description import HeadLimits
from drivers.kinds.head.driver import Head


class AerotechEnsemble(Head):
    """A Positioner."""

    def __init__(self, setup: Setup[EnsembleOptions, HeadLimits, Nothing]) -> None:
        super().__init__(setup.name, EnsembleAxis(setup), setup.options, setup.limits)
