"""Counters on bad buses: every kind of fault, through the real intake, against what was really sent."""
