"""Simulated flights of calibrated units: velocity from their counts against a known one."""
