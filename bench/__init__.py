"""The orchestrator of an inertial-sensor test bench."""
