"""The figures that a part of a report draws, before they become pictures."""

from __future__ import annotations

from types import ModuleType

import pytest
from matplotlib.figure import Figure


def kept_figures(monkeypatch: pytest.MonkeyPatch, module: ModuleType) -> dict[str, Figure]:
    """By their titles the figures that a module renders from now on; nothing is made of them."""
    figures: dict[str, Figure] = {}

    def keep(figure: Figure, _name: str, title: str) -> str:
        figures[title] = figure
        return ""

    monkeypatch.setattr(module, "rendered", keep)
    return figures
