"""Recognition of a Yokogawa GS200."""

from __future__ import annotations

from drivers.discovery.recognition import SCPI, Recognition, answers_idn

RECOGNITION = Recognition(
    SCPI,
    answers_idn(r"YOKOGAWA", r"GS2[01]0"),
    starter={
        "options": {"range": "1 mA", "compliance": "1 V"},
        "limits": {"current": {"min": "-1 mA", "max": "1 mA"}},
    },
)
