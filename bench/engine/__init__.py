"""Run a plan on a rig: steps, readings, safe state and record."""
