"""Runs a plan on a rig: steps, readings, safety, record."""
