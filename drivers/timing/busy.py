"""Default time for which a working device may give no reading."""

from __future__ import annotations

BUSY_S = 120.0  # a dialogue that is asked again, a connection made anew, and any command of a device that only answers
