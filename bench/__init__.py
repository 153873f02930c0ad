"""Orchestrator of an inertial-sensor test bench."""
