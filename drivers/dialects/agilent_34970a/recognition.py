"""Recognition of an Agilent 34970A or 34972A."""

from __future__ import annotations

from drivers.dialects.agilent_34970a.wire import read_identity
from drivers.discovery.recognition import SCPI, Recognition, answers_idn

RECOGNITION = Recognition(
    SCPI,
    answers_idn(r"(HEWLETT-PACKARD|Agilent.*|Keysight.*)", r"3497[02]A", read=read_identity),
    starter={"options": {"channels": {"first": {"channel": 101, "sensor": "tc", "type": "K"}}}},
    lines=("baud=57600&flow=xonxoff", "baud=9600"),
)
