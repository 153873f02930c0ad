"""Simulated instruments at the end of real and in-process connections."""
