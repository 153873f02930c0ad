"""Instruments of a station's benches: identity, calibration, last errors, who holds them. Nothing here opens one."""
