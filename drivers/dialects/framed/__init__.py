"""Heads and rate tables with fixed-length frames, described by a profile file."""
