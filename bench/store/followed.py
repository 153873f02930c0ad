"""What guardians have recorded of chambers after their runs: commanded, held, arrived or not."""

from __future__ import annotations

FOLLOWED_FILE = "followed.jsonl"
