"""Kinds of campaigns that need the sources of this program, not only its installation."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from bench.campaign.program import ROOT
from bench.campaign.tasks import Campaign
from bench.errors import InputError

FOLDER = "campaigns"


def of_sources(name: str, **options: Any) -> Campaign:
    """Return a campaign of `campaigns.kinds.<name>` with its options.

    Raises InputError without the sources around this package, or without what they need.
    """
    lacking = f"bench campaign {name.replace('_', '-')}: is for the sources of this program"
    if not (ROOT / FOLDER / "kinds").is_dir():
        raise InputError(
            f"{lacking}, which are not around {ROOT / 'bench'}. Get them, with the tag of this version, and run the "
            "command there: .venv/bin/bench after 'make setup'"
        )
    try:
        module = import_module(f"{FOLDER}.kinds.{name}")
    except ImportError as problem:
        raise InputError(
            f"{lacking}, and cannot be imported ({problem}); run the command there after 'make setup'"
        ) from None
    if not Path(str(module.__file__)).is_relative_to(ROOT):
        raise InputError(f"{lacking}: 'bench' is in {ROOT}, and 'campaigns' in {Path(str(module.__file__)).parents[2]}")
    campaign: Campaign = module.campaign(**options)
    return campaign
