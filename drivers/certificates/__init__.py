"""Corrections and uncertainties from calibration certificates."""
