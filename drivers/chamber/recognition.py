"""What a chamber that a scan has found may do, until somebody says more."""

from __future__ import annotations

from drivers.recognition import Blocks

CHAMBER_STARTER: Blocks = {
    "limits": {"temperature": {"min": "15 °C", "max": "35 °C"}, "ramp_rate": {"max": "1 °C/min"}},
    "safe": {"temperature": "25 °C"},
}
