"""Conservative limits of an indexing head found by a scan."""

from __future__ import annotations

from drivers.discovery.recognition import Blocks

HEAD_STARTER: Blocks = {
    "options": {"rate": "2 °/s", "settle": {"band": "10 arcsec", "hold": "1 s"}},
    "limits": {"angle": {"min": "-5°", "max": "5°"}, "rate": {"max": "2 °/s"}},
}
