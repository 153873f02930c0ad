"""Calibrations of units: how an output is converted to what it measures."""
