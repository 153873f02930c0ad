"""Edits that put a 3458A into the cable of the current source of a bench for channels."""

from __future__ import annotations

from pathlib import Path

DEVICE = """  dmm:
    driver: keysight_3458a_ammeter
    connection: sim+tcp://127.0.0.1:1235
    options: {range: 10 mA, nplc: 100}
    identity: {model: 3458A, serial: SIM-3458A-02}
    calibration:
      {certificate: SIM-2026-0109, laboratory: none, date: 2026-01-01, due: 2030-12-31, k: 2, U: {STATED}}

# Named readings of the devices"""
GOOD = "gain: 8 ppm, offset: 4 nA"
CABLE = "    source: source                               #"


def put_into_cable(bench: Path, *, stated: str = GOOD, noise: str = "0 A") -> Path:
    """Edits a copy of `channel.yaml`: an ammeter with these expanded uncertainties, that reads with this noise."""
    text = bench.read_text("utf-8")
    for old, new in (
        ("# Named readings of the devices", DEVICE.replace("STATED", stated)),
        (CABLE, f"    ammeter: dmm\n{CABLE}"),
        ("  host_clock:", f"  ammeters: {{dmm: {{noise: {noise}}}}}\n  host_clock:"),
    ):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    bench.write_text(text, "utf-8")
    return bench
