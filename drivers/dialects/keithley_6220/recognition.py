"""Recognition of a Keithley 6220 or 6221."""

from __future__ import annotations

from drivers.discovery.recognition import SCPI, Recognition, answers_idn

RECOGNITION = Recognition(
    SCPI,
    answers_idn(r"KEITHLEY.*", r"(MODEL )?622[01].*", terminators=True),
    starter={
        "options": {"range": "2 mA", "compliance": "1 V"},
        "limits": {"current": {"min": "-1 mA", "max": "1 mA"}},
    },
    lines=("baud=9600", "baud=19200"),
)
