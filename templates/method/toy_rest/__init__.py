"""Output and drift of a unit at rest: a method of the inertial test bench."""
