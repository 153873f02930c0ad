"""Recognition of a Fluke 5700A, 5720A or 5730A."""

from __future__ import annotations

from drivers.dialects.fluke_5700a.wire import MODELS
from drivers.discovery.recognition import SCPI, Recognition, answers_idn

RECOGNITION = Recognition(
    SCPI,
    answers_idn(r"FLUKE", "|".join(MODELS), terminators=True),
    starter={
        "options": {"range": "2.2 mA", "compliance": "10 V"},
        "limits": {"current": {"min": "-1 mA", "max": "1 mA"}},
    },
    lines=("baud=9600",),
)
