"""Default time for which a working device may give no reading."""

from __future__ import annotations

BUSY_S = 120.0  # for a repeated dialogue, a reconnection, and any command of a device that only answers
