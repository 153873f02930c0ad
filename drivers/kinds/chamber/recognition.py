"""Conservative limits of a chamber found by a scan."""

from __future__ import annotations

from drivers.discovery.recognition import Blocks

CHAMBER_STARTER: Blocks = {
    "limits": {"temperature": {"min": "15 °C", "max": "35 °C"}, "ramp_rate": {"max": "1 °C/min"}},
    "safe": {"temperature": "25 °C"},
}
