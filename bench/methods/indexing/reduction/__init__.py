"""Reduction of sweeps to scale factor, bias, misalignment and cross coupling."""
