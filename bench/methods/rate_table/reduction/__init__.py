"""Reduction of rates and oscillations to errors over the range, gain and phase."""
