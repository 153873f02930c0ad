"""How long a device in order may give no reading, where nothing else is derived for it."""

from __future__ import annotations

BUSY_S = 120.0  # a dialogue that is asked again, a connection made anew, and any command of a device that only answers
