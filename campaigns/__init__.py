"""Campaigns: many trials of one property, by hand or at night. Run one with `python -m campaigns.NAME`."""

import tests  # noqa: F401  which gives every run a folder for its states
