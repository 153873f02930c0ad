"""Estimated duration of a plan, with settling and thermal lags."""
