"""Execution of one run in one process: opened devices, plan, signals and manifest."""
